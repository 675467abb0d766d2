"""The photographs of a result, opened again where the result does not hold their pixels."""

import contextlib
from collections.abc import Iterator

from zpm2.config import RasterConfig
from zpm2.errors import InputError
from zpm2.model import Image, ImagePolygons
from zpm2.photos.source import InMemoryPhoto, Source, open_source, reduced


@contextlib.contextmanager
def reopened(side: ImagePolygons, name: str, config: RasterConfig) -> Iterator[Source]:
    """The photograph of one side: from memory where the result holds it in full or where it has no file, else its file.

    `InputError` where the file is no longer there or has another size, or where there is neither file nor pixels.
    """
    if side.image is not None and (side.image.width == side.width or side.path is None):
        yield InMemoryPhoto(side.image)
        return
    if side.path is None:
        raise InputError(f"the {name} photograph was given as pixels and is not part of the saved result")
    source = open_source(side.path, f"{name} image", config)
    try:
        if (source.width, source.height) != (side.width, side.height):
            raise InputError(
                f"{name} image {side.path} has {source.width} x {source.height} px and had {side.width} x "
                f"{side.height} px when it was matched; run zpm2 match again"
            )
        yield source
    finally:
        source.close()


def pixels(side: ImagePolygons, name: str, config: RasterConfig, longest: int | None = None) -> Image:
    """The photograph of one side; with `longest` the one in memory at any size, else one of at most `longest` px."""
    if side.image is not None and (longest is not None or side.image.width == side.width):
        return side.image
    with reopened(side, name, config) as source:
        return source.read() if longest is None else reduced(source, longest)
