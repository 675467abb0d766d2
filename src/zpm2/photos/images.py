"""Photographs from a path, an array or a PIL picture as `model.Image`."""

from contextlib import closing

from zpm2.config import RasterConfig
from zpm2.model import Image
from zpm2.photos import checks
from zpm2.photos.checks import MAX_PIXELS
from zpm2.photos.source import DEFAULTS, ImageLike, Source, open_source


def read_image(source: ImageLike, name: str = "image", config: RasterConfig = DEFAULTS) -> Image:
    """8-bit RGB pixels of a photograph in its stored pixel frame, where it holds data, and a note for everything that
    was done to the pixels.

    source: a path; an array (h, w), (h, w, 1), (h, w, 3) or (h, w, 4) of bool, integers or floats, channels in RGB(A)
        order; a PIL picture of any mode; or an `Image`, which is taken as it is. name: what error messages call it,
        for example "left image". config: its `bands` are those of a file, from 1: one for grey or three for red, green,
        blue; default: those that the file marks so, else the first one of at most two, else the first three.

    Files are read by the library that `open_source` chooses. Grey becomes RGB, other colour models are converted.
    Floats within 0..1 are scaled by 255; floats and wide integers within 0..255 are taken as they are; all other
    values, and those that use less than a quarter of their range, are stretched to 8 bit from the 0.5 to the 99.5
    percentile, all channels alike. An EXIF orientation is reported and not applied. Only the first page of a file is
    read.

    No data (`Image.valid`) are: transparent pixels (alpha 0), a file's nodata values and masked pixels, and NaN and
    infinity in a file. Where the values of a file are stretched, one value that fills its border, or a twentieth of the
    photograph and a part of its border, is taken as no data too, which a note says. Pixels without data are 0.

    Raises `InputError` for whatever cannot be read or matched: a missing, empty, damaged or foreign file, NaN in an
    array, a wrong shape or type, complex values, no pixel with data, a side under 32 px, more than 1 gigapixel.
    """
    if isinstance(source, Image):
        checks.check(source.rgb, name)
        return source
    with closing(open_source(source, name, config)) as opened:
        return whole(opened, name)


def whole(source: Source, name: str) -> Image:
    """All of a photograph at full size; `InputError` above 1 gigapixel."""
    if source.width * source.height > MAX_PIXELS:
        raise checks.too_large(name)
    return source.read()
