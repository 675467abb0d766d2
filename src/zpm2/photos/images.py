"""Photographs from a path, an array or a PIL picture as `model.Image`."""

from contextlib import closing
from dataclasses import replace

from zpm2.config import RasterConfig
from zpm2.model import Image
from zpm2.photos import checks
from zpm2.photos.checks import MAX_PIXELS
from zpm2.photos.source import DEFAULTS, ImageLike, Source, open_source


def read_image(source: ImageLike, name: str = "image", config: RasterConfig = DEFAULTS) -> Image:
    """A photograph as 8-bit RGB in its stored pixel frame, with a mask of valid pixels and a note for each conversion.

    source: a path; an array (h, w), (h, w, 1), (h, w, 3) or (h, w, 4) of bool, integers or floats, channels in RGB(A)
        order; a PIL picture of any mode; or an `Image`, (h, w, 3) uint8 and some pixel valid, which is returned as it
        is. name: what error messages call it, for example "left image". config: its `bands` choose bands of a file,
        from 1 on: one for grey or three for red, green, blue; by default those that the file marks as colours, else the
        first of at most two, else the first three.

    Files are read by the library that `open_source` chooses. Grey becomes RGB, other colour models are converted.
    Floats within 0..1 are scaled by 255; floats and wide integers within 0..255 stay as they are. All other values, and
    those that use less than a quarter of their range, are stretched to 8 bit from the 0.5 to the 99.5 percentile, all
    channels alike. An EXIF orientation is reported but not applied. Only the first page of a file is
    read.

    Pixels without data (`Image.valid` is false) are transparent (alpha 0), masked (in a numpy masked array: in any
    band), NaN, infinite, or have the file's nodata value. Where the values of a file are stretched, a value also counts
    as no data if it fills the border, or a twentieth of the photograph and a part of the border; a note says so. Pixels
    without data become 0.

    Raises `InputError` for whatever cannot be read or matched: a missing, empty, damaged or unknown file, NaN in an
    array, a wrong shape or type, complex values, no pixel with data, a side under 32 px, more than 1 gigapixel, or more
    than fits into the memory budget.
    """
    if isinstance(source, Image):
        checks.check_image(source, name)
        return source
    with closing(open_source(source, name, config)) as opened:
        return whole(opened, name)


def whole(source: Source, name: str) -> Image:
    """All of a photograph at full size, with its georeference; `InputError` above 1 gigapixel."""
    if source.width * source.height > MAX_PIXELS:
        raise checks.too_large(name)
    return replace(source.read(), geo=source.geo)
