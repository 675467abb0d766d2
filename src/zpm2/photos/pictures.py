"""Pictures read by Pillow as a whole: files, and PIL pictures in memory. And RGB pixels as a PNG file."""

import struct
import threading
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.config import StretchConfig
from zpm2.errors import InputError
from zpm2.files.reading import regular
from zpm2.model import Image
from zpm2.model.messages import Note
from zpm2.photos import checks, radiometry
from zpm2.photos.radiometry import Values

# Pillow's names of the formats that we read. We try no others: the one for PostScript, for example, starts a program.
FORMATS = (
    *("AVIF", "BMP", "DDS", "DIB", "GIF", "ICO", "JPEG", "JPEG2000", "MPO", "PCX", "PNG", "PPM", "QOI", "SGI", "TGA"),
    *("TIFF", "WEBP"),
)

PAGES = 100  # counted at most: each takes longer to find than the one before
EXIF_IFD = 0x8769  # tag of the part of EXIF that tells of camera and time
_EXIF_ORIENTATION = 274
_BITS, _SAMPLE_FORMAT, _GDAL_NODATA = 258, 339, 42113  # tags of a TIFF
DAMAGE = (
    OSError,
    SyntaxError,
    EOFError,
    LookupError,
    ValueError,
    TypeError,
    ArithmeticError,
    struct.error,
    zlib.error,
)
# PIL turns TIFF pages (and nothing else) by their orientation tag while it loads them; this undoes it
_UNDO_ORIENTATION = {
    2: PIL.Image.Transpose.FLIP_LEFT_RIGHT,
    3: PIL.Image.Transpose.ROTATE_180,
    4: PIL.Image.Transpose.FLIP_TOP_BOTTOM,
    5: PIL.Image.Transpose.TRANSPOSE,
    6: PIL.Image.Transpose.ROTATE_90,
    7: PIL.Image.Transpose.TRANSVERSE,
    8: PIL.Image.Transpose.ROTATE_270,
}
Tags = Mapping[int, Sequence[int]]  # of a TIFF, by number; texts among them

_pil_lock = threading.Lock()


class UnknownFormat(InputError):
    """A file in a format that Pillow does not read."""


def read_file(path: Path, what: str, stretch: StretchConfig = radiometry.DEFAULTS) -> Image:
    """The first picture of a file, by the rules of `read_image`. `UnknownFormat` where Pillow does not know the format,
    another `InputError` where it cannot decode the file."""
    with checks.opened_file(path, what) as file, _pixel_limit(what):
        picture = _opened(file, what)
        checks.check_length(*picture.size, picture.format or "", path, what)
        checks.check_memory(*picture.size, _bytes_each(picture), what)
        deep = picture.mode in ("RGB", "RGBA", "RGBX", "LA") and ";16" in str(getattr(picture, "tile", ""))
        pixels, notes, nodata = _unpacked(picture, what)
    if deep:
        pixels, notes = _deep_color(path, pixels, notes)
    return radiometry.to_image(pixels, what, str(path), notes, nodata, stretch)


def from_picture(picture: PIL.Image.Image, what: str, stretch: StretchConfig = radiometry.DEFAULTS) -> Image:
    """A picture in memory, by the rules of `read_image`."""
    checks.check_memory(*picture.size, _bytes_each(picture), what)
    with _pixel_limit(what):
        pixels, notes, nodata = _unpacked(picture, what)
    return radiometry.to_image(pixels, what, None, notes, nodata, stretch)


def opened(file: Path | BinaryIO) -> PIL.Image.Image:
    """Pillow's picture of a path or open file of one of our `FORMATS`. Other calls of
    `PIL.Image.open` name their format. Errors are those of `PIL.Image.open`."""
    PIL.Image.init()
    return PIL.Image.open(file, formats=[name for name in FORMATS if name in PIL.Image.OPEN])  # Pillow may lack some


def header(path: Path) -> tuple[tuple[int, int], list[str]] | None:
    """(width, height) px as the file stores them, and the notes on its orientation and pages; None where Pillow
    cannot read it. No pixel is decoded."""
    notes: list[str] = []
    try:
        with looked_at(path) as picture:
            orientation = _orientation(lambda: exif_of(picture), notes)
            size = picture.size
            if picture.format == "TIFF":
                size = picture.tag_v2[256], picture.tag_v2[257]  # type: ignore[attr-defined]
            elif (pages := count_pages(picture)) != "1":
                notes.append(first_page_note(pages))
    except DAMAGE:
        return None
    return size, notes if orientation == 1 else [*notes, _orientation_note(orientation)]


def is_progressive(path: Path) -> bool:
    """Whether a file is a progressive JPEG, which cannot be read in parts."""
    try:
        with looked_at(path) as picture:
            return "progressive" in picture.info
    except DAMAGE:
        return False


@contextmanager
def looked_at(path: str | Path) -> Iterator[PIL.Image.Image]:
    """A picture of any size, opened for its header only. Raises one of `DAMAGE` where it cannot be read."""
    with _pil_lock, warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="PIL")
        before, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None
        try:
            with opened(regular(Path(path))) as picture:
                yield picture
        except MemoryError as error:
            raise OSError("it declares more pixels than fit into memory") from error
        finally:
            PIL.Image.MAX_IMAGE_PIXELS = before


def count_pages(picture: PIL.Image.Image) -> str:
    """How many pages a file has, in words. In a TIFF no more than `PAGES` are counted, as each has to be searched for.
    The current page stays the same."""
    if picture.format != "TIFF":
        return str(getattr(picture, "n_frames", 1))
    here = picture.tell()
    try:
        for page in range(PAGES + 1):
            picture.seek(page)
    except EOFError:
        return str(page)
    finally:
        picture.seek(here)
    return f"more than {PAGES}"


def first_page_note(pages: int | str) -> str:
    """The note for a file with several pages."""
    return f"Only the first of {pages} pictures in the file is used."


def _opened(file: Path | BinaryIO, what: str) -> PIL.Image.Image:
    try:
        return opened(file)
    except PIL.UnidentifiedImageError as error:
        raise UnknownFormat(str(checks.unknown_format(what))) from error
    except DAMAGE as error:
        raise checks.damaged(what, error) from error


def _unpacked(picture: PIL.Image.Image, what: str) -> tuple[Values, list[str], float | None]:
    """The pixels of a PIL picture in RGB(A) or grey with their own bit depth; notes on conversions; and the nodata
    value, None where there is none."""
    notes: list[str] = []
    try:
        pages = count_pages(picture)
        orientation = _orientation(picture.getexif, notes)
        picture.load()
    except DAMAGE as error:
        raise checks.damaged(what, error) from error
    tags: Tags = getattr(picture, "tag_v2", {})
    info, stored = dict(picture.info), picture.mode
    if picture.format == "TIFF" and orientation in _UNDO_ORIENTATION:
        picture = picture.transpose(_UNDO_ORIENTATION[orientation])
    if pages != "1":
        notes.append(first_page_note(pages))
    if orientation != 1:
        notes.append(_orientation_note(orientation))
    if picture.mode in ("P", "PA"):
        notes.append(Note("The colour palette was expanded to RGB."))
    keyed = picture.mode in ("1", "L", "P", "RGB") and "transparency" in info  # one colour is transparent
    if keyed or picture.mode in ("LA", "La", "PA", "RGBa"):
        if picture.mode == "1":
            notes.append(Note("1-bit values became black and white."))
        picture = (picture.convert("LA") if picture.mode == "La" else picture).convert("RGBA")
    elif picture.mode == "P":
        picture = picture.convert("RGB")
    elif picture.mode not in ("1", "L", "RGB", "RGBA", "I", "F") and not picture.mode.startswith("I;16"):
        notes.append(Note(f"The colours were converted from {picture.mode} to RGB."))
        try:
            picture = picture.convert("RGB")
        except ValueError as error:
            raise InputError(f"{what} has colour model {picture.mode}: convert it to RGB first") from error
    nodata = _number(tags.get(_GDAL_NODATA, info.get("transparency"))) if picture.mode == stored else None
    return _signed(np.asarray(picture), tags), notes, nodata


def _bytes_each(picture: PIL.Image.Image) -> int:
    """Memory per pixel during the conversion to 8-bit RGB, in bytes: Pillow's, the array's, and the result's."""
    bands, kind = len(picture.getbands()), {"1": 1, "I": 4, "F": 4}.get(picture.mode[:1], 1)
    kind = 2 if ";16" in str(getattr(picture, "tile", "")) or ";16" in picture.mode else kind
    return (4 if bands > 1 else kind) + 2 * bands * kind + 3


def _number(text: object) -> float | None:
    try:
        return float(str(text).strip(" \0"))
    except ValueError:
        return None


def _signed(pixels: Values, tags: Tags) -> Values:
    """TIFF integers with their true sign: PIL takes 8-bit ones for unsigned and 32-bit ones for signed."""
    kind = tags.get(_SAMPLE_FORMAT, (1,))[0]
    if kind == 2 and pixels.dtype == np.uint8:
        return pixels.view(np.int8)
    if kind == 1 and pixels.dtype == np.int32 and tags.get(_BITS, (0,))[0] == 32:
        return pixels.view(np.uint32)
    return pixels


def _orientation_note(orientation: int) -> str:
    return f"The EXIF orientation ({orientation}) is not applied; results are in the stored pixel frame."


def exif_of(picture: PIL.Image.Image) -> PIL.Image.Exif:
    """The EXIF data of a file's header. Pillow itself would decode a PNG without EXIF, to search after its pixels."""
    return PIL.Image.Image.getexif(picture) if picture.format == "PNG" else picture.getexif()


def _orientation(exif: Callable[[], PIL.Image.Exif], notes: list[str]) -> int:
    try:
        value = exif().get(_EXIF_ORIENTATION, 1)
    except DAMAGE:
        notes.append(Note("The EXIF data is damaged and was ignored."))
        return 1
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def _deep_color(path: Path, pixels: Values, notes: list[str]) -> tuple[Values, list[str]]:
    """16-bit colour with all its bits, read by OpenCV: PIL keeps only the upper eight."""
    found = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None or found.ndim != 3 or found.shape[2] not in (3, 4):
        return pixels, [*notes, "16-bit colours were cut to their upper 8 bits."]
    return found[..., [2, 1, 0, 3][: found.shape[2]]], notes


@contextmanager
def _pixel_limit(what: str) -> Iterator[None]:
    """Sets PIL's guard against decompression bombs to our own limit, inside this block only."""
    with _pil_lock, warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="PIL")  # on metadata; problems that matter become errors or notes
        warnings.simplefilter("error", PIL.Image.DecompressionBombWarning)
        before, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, checks.MAX_PIXELS
        try:
            yield
        except (PIL.Image.DecompressionBombError, PIL.Image.DecompressionBombWarning) as error:
            raise checks.too_large(what) from error
        except MemoryError as error:
            raise checks.no_memory(what) from error
        finally:
            PIL.Image.MAX_IMAGE_PIXELS = before


def png(rgb: NDArray[np.uint8]) -> bytes:
    """(h, w, 3) RGB pixels as the content of a PNG file."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes())
