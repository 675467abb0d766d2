"""A photograph as the page works with it: whole, or reduced where it is large."""

import math
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config
from zpm2.errors import InputError
from zpm2.formats.regions.region import Shape
from zpm2.model import Georeference, Image
from zpm2.model.messages import Note
from zpm2.photos.pictures import header
from zpm2.photos.source import ImageLike, open_source, reduced

QUALITY = 90  # 1..100, of the picture that the page shows (WebP)
MOST_PIXELS = 250_000_000  # of a photograph that a browser sends; a small file may hold many


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph of the pair; all that leaves the app is in its own px."""

    name: str  # of the file
    path: str | None  # None: it was sent by the browser
    width: int  # px
    height: int  # px
    geo: Georeference
    messages: tuple[str, ...]  # about how it was read
    image: Image  # what the networks see, maybe reduced

    @property
    def scale(self) -> NDArray[np.float64]:
        """(2,) px of `image` per px of the photograph."""
        return np.array([self.image.width / self.width, self.image.height / self.height])

    def to_image(self, shape: Shape) -> Shape:
        """A shape, px of the photograph, in px of `image`."""
        return shapely.transform(shape, lambda xy: xy * self.scale)

    def from_image(self, shape: Shape) -> Shape:
        """A shape, px of `image`, in px of the photograph."""
        return shapely.transform(shape, lambda xy: xy / self.scale)

    def picture(self) -> bytes:
        """`image` as WebP."""
        bgr = cv2.cvtColor(self.image.rgb, cv2.COLOR_RGB2BGR)
        return bytes(cv2.imencode(".webp", bgr, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1])


def read(source: ImageLike, name: str, side: str, config: Config, most: float = math.inf) -> Photograph:
    """A photograph of any size. One that `zpm2 carry` would look at by windows is reduced to the largest size that it
    sees as a whole, and a message says so. `InputError` as from `open_source`, whose text names the `side`, and for
    more than `most` px."""
    seen = 2 * config.carry.window
    with closing(open_source(source, f"{side} image", config.raster)) as opened:
        _refuse_above(most, opened.width, opened.height, name)
        image = replace(reduced(opened, seen), geo=opened.geo)
        messages = opened.notes
        if image.width < opened.width:
            text = (
                f"{name} is looked at with {image.width} x {image.height} of its {opened.width} x {opened.height} px: "
                "outlines are as coarse as that, zpm2 carry makes finer ones"
            )
            messages = (*messages, Note(text))
        return Photograph(name, opened.path, opened.width, opened.height, opened.geo, tuple(messages), image)


def received(path: Path, name: str, side: str, config: Config) -> Photograph:
    """A photograph that a browser sent, from a file that will not stay. `InputError` as from `read`, and for more than
    `MOST_PIXELS`, before they are decoded."""
    try:
        if (found := header(path)) is not None:
            _refuse_above(MOST_PIXELS, *found[0], name)
        photograph = read(path, name, side, config, MOST_PIXELS)
    except InputError as error:
        raise InputError(str(error).replace(str(path), name)) from error
    return replace(photograph, path=None, image=replace(photograph.image, path=None))


def _refuse_above(most: float, width: int, height: int, name: str) -> None:
    if width * height > most:
        raise InputError(
            f"{name} has {width} x {height} px, more than the {MOST_PIXELS // 10**6} megapixels that the page takes: "
            "give its path to zpm2 app"
        )
