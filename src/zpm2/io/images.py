"""Photographs in: a path, an array or a PIL picture becomes a `model.Image`, or one line says why it cannot."""

import math
import struct
import threading
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.messages import Note
from zpm2.model import Image

MIN_SIDE = 32  # px, below this there is nothing to segment
MAX_PIXELS = 1_000_000_000  # px, beyond this a file is refused before it is unpacked
STRETCH = (0.5, 99.5)  # percentiles that become 0 and 255 where values have no 8-bit meaning

_EXIF_ORIENTATION = 274
_DAMAGE = (
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
# PIL turns TIFF pages (and only those) by their orientation tag while it loads them; this turns them back
_UNDO_ORIENTATION = {
    2: PIL.Image.Transpose.FLIP_LEFT_RIGHT,
    3: PIL.Image.Transpose.ROTATE_180,
    4: PIL.Image.Transpose.FLIP_TOP_BOTTOM,
    5: PIL.Image.Transpose.TRANSPOSE,
    6: PIL.Image.Transpose.ROTATE_90,
    7: PIL.Image.Transpose.TRANSVERSE,
    8: PIL.Image.Transpose.ROTATE_270,
}
_pil_lock = threading.Lock()


def read_image(source: str | Path | NDArray[Any] | PIL.Image.Image | Image, name: str = "image") -> Image:
    """8-bit RGB pixels of a photograph in its stored pixel frame, with a note for everything that was done to them.

    source: a path; an array (h, w), (h, w, 1), (h, w, 3) or (h, w, 4) of bool, integers or floats, channels in RGB(A)
        order; a PIL picture of any mode; or an `Image`, which is taken as it is. name: what error messages call it,
        for example "left image".

    Grey becomes RGB, alpha is dropped, other colour models are converted. Floats within 0..1 are scaled by 255; floats
    and wide integers within 0..255 are taken as they are; all other values, and those that use less than a quarter of
    their range, are stretched to 8 bit from the 0.5 to the 99.5 percentile, all channels alike. An EXIF orientation is
    reported and not applied. Only the first page of a file is read.

    Raises `InputError` for whatever cannot be read or matched: a missing, empty, damaged or foreign file, NaN, a
    wrong shape or type, a side under 32 px, more than 1 gigapixel.
    """
    if isinstance(source, Image):
        _check(source.rgb, name)
        return source
    if isinstance(source, str | Path):
        what = f"{name} {source}"
        values, notes = _from_file(Path(source), what)
        return _finish(values, notes, what, str(source))
    if isinstance(source, PIL.Image.Image):
        with _pixel_limit(name):
            values, notes = _from_pil(source, name)
        return _finish(values, notes, name, None)
    if isinstance(source, np.ndarray):
        return _finish(source, [], name, None)
    raise InputError(f"{name}: expected a path, a numpy array or a PIL picture, got {type(source).__name__}")


def _from_file(path: Path, what: str) -> tuple[NDArray[Any], list[str]]:
    with opened_file(path, what) as file, _pixel_limit(what):
        picture = _opened(file, what)
        deep = picture.mode in ("RGB", "RGBA", "RGBX") and ";16" in str(getattr(picture, "tile", ""))
        values, notes = _from_pil(picture, what)
    return _deep_color(path, values, notes) if deep else (values, notes)


@contextmanager
def opened_file(path: Path, what: str) -> Iterator[BinaryIO]:
    """The file, which has something in it, open for reading; `InputError` for what the system has against that."""
    try:
        with path.open("rb") as file:
            if not file.read(1):
                raise InputError(f"{what} is empty (0 bytes): copy or download it again")
            file.seek(0)
            yield file
    except FileNotFoundError as error:
        raise InputError(f"{what} does not exist: check the path") from error
    except IsADirectoryError as error:
        raise InputError(f"{what} is a folder: give the path of a picture in it") from error
    except PermissionError as error:
        raise InputError(f"{what} may not be read: change its permissions or copy it") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{what} cannot be read: {_one_line(error)}") from error


def _opened(file: Any, what: str) -> PIL.Image.Image:
    try:
        return PIL.Image.open(file)
    except PIL.UnidentifiedImageError as error:
        raise InputError(f"{what} is not a picture in a known format: give a PNG, JPEG or TIFF file") from error
    except _DAMAGE as error:
        raise damaged(what, error) from error


def _from_pil(picture: PIL.Image.Image, what: str) -> tuple[NDArray[Any], list[str]]:
    """The pixels of a PIL picture, fully unpacked, with their own depth; colour models other than RGB converted."""
    notes: list[str] = []
    try:
        pages = getattr(picture, "n_frames", 1)
        orientation = _orientation(picture, notes)
        picture.load()
    except _DAMAGE as error:
        raise damaged(what, error) from error
    if picture.format == "TIFF" and orientation in _UNDO_ORIENTATION:
        picture = picture.transpose(_UNDO_ORIENTATION[orientation])
    if pages > 1:
        notes.append(first_page_note(pages))
    if orientation != 1:
        notes.append(_orientation_note(orientation))
    if picture.mode in ("P", "PA"):
        notes.append(Note("The colour palette was expanded to RGB."))
    if picture.mode in ("LA", "La", "PA", "RGBa") or (picture.mode == "P" and "transparency" in picture.info):
        picture = picture.convert("RGBA")
    elif picture.mode == "P":
        picture = picture.convert("RGB")
    elif picture.mode not in ("1", "L", "RGB", "RGBA", "I", "F") and not picture.mode.startswith("I;16"):
        notes.append(Note(f"The colours were converted from {picture.mode} to RGB."))
        try:
            picture = picture.convert("RGB")
        except ValueError as error:
            raise InputError(f"{what} has colour model {picture.mode}: convert it to RGB first") from error
    return np.asarray(picture), notes


def first_page_note(pages: int) -> str:
    return f"Only the first of {pages} pictures in the file is used."


def orientation_notes(path: str | Path) -> list[str]:
    """The note for a picture file with an EXIF orientation, whatever its size; none where there is no telling."""
    notes: list[str] = []
    with _pil_lock, warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="PIL")
        before, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None  # nothing is unpacked
        try:
            with PIL.Image.open(path) as picture:
                orientation = _orientation(picture, notes)
        except _DAMAGE:
            return []
        finally:
            PIL.Image.MAX_IMAGE_PIXELS = before
    return notes if orientation == 1 else [*notes, _orientation_note(orientation)]


def _orientation_note(orientation: int) -> str:
    return f"The EXIF orientation ({orientation}) is not applied; results are in the stored pixel frame."


def _orientation(picture: PIL.Image.Image, notes: list[str]) -> int:
    try:
        value = picture.getexif().get(_EXIF_ORIENTATION, 1)
    except _DAMAGE:
        notes.append(Note("The EXIF data is damaged and was ignored."))
        return 1
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def _deep_color(path: Path, values: NDArray[Any], notes: list[str]) -> tuple[NDArray[Any], list[str]]:
    """16-bit colour with all its bits, which PIL cuts to the upper eight."""
    pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        return values, [*notes, "16-bit colours were cut to their upper 8 bits."]
    return pixels[..., [2, 1, 0, 3][: pixels.shape[2]]], notes


def _finish(values: NDArray[Any], notes: list[str], what: str, path: str | None) -> Image:
    """Checks, drops alpha, brings the values to 8 bit and grey to RGB."""
    _check(values, what)
    if values.dtype == np.bool_:
        values = values.astype(np.uint8) * 255
        notes = [*notes, Note("1-bit values became black and white.")]
    if values.ndim == 3 and values.shape[2] == 4:
        notes = [*notes, _alpha_note(values[..., 3])]
        values = values[..., :3]
    if values.dtype != np.uint8:
        low, high, note = brightness_range(values)
        values = scaled(values, low, high)
        notes = [*notes, note]
    rgb = np.empty((*values.shape[:2], 3), np.uint8)
    rgb[...] = values if values.ndim == 3 else values[..., None]
    return Image(rgb, path, tuple(notes))


def _check(values: NDArray[Any], what: str) -> None:
    shape = " x ".join(map(str, values.shape))
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (1, 3, 4)):
        hint = ": move the channels last" if values.ndim == 3 and values.shape[0] in (1, 3, 4) else ""
        raise InputError(f"{what}: expected (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), got {shape or 'a scalar'}{hint}")
    height, width = values.shape[:2]
    check_sides(width, height, what)
    if height * width > MAX_PIXELS:
        raise _too_large(what)
    if values.dtype.kind not in "buif":
        raise InputError(f"{what}: expected bool, integer or float values, got {values.dtype}")
    if values.dtype.kind == "f":
        bad = values.size - int(np.count_nonzero(np.isfinite(values)))
        if bad:
            raise InputError(f"{what} has {bad} NaN or infinite values: replace them before matching")


def check_sides(width: int, height: int, what: str) -> None:
    if min(height, width) < MIN_SIDE:
        raise InputError(f"{what} is {width} x {height} px: each side must have at least {MIN_SIDE} px")


def _alpha_note(alpha: NDArray[Any]) -> str:
    most = float(alpha.max())
    levels = (1.0, 255.0, 65535.0) if alpha.dtype.kind == "f" else (255.0, 65535.0)
    opaque = next((level for level in levels if most <= level), most)
    share = float(np.count_nonzero(alpha < opaque)) / alpha.size
    if share == 0:
        return Note("The alpha band was dropped; every pixel was opaque.")
    return Note(f"The alpha band was dropped; {max(share, 0.001):.1%} of the pixels were transparent.")


def brightness_range(values: NDArray[Any]) -> tuple[float, float, str]:
    """The values that become 0 and 255, and the note that says so. See `read_image` for the rule.

    values: (h, w) or (h, w, bands), floats (finite) or integers.
    """
    floating = values.dtype.kind == "f"
    kind = f"{values.dtype.itemsize * 8}-bit {'floats' if floating else 'integers'}"
    step = max(1, math.isqrt(values.shape[0] * values.shape[1] // 4_000_000))
    low, high = (float(v) for v in np.percentile(values[::step, ::step].astype(np.float64), STRETCH))
    least, most = float(values.min()), float(values.max())
    for full in (1.0, 255.0) if floating else (255.0,):
        if least >= 0 and most <= full and high >= full / 4:
            return 0.0, full, Note(f"The {kind} were read as brightness from 0 to {full:g}.")
    if high <= low:
        low, high = least, most
    return low, high, Note(f"The {kind} were stretched to 8 bit from the range {low:g} to {high:g}.")


def scaled(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    """Finite values of any shape as 8 bit: `low` becomes 0 and `high` 255, what lies beyond is cut off."""
    scale = 255 / (high - low) if high > low else 0.0
    out = np.empty(values.shape, np.uint8)
    for row in range(0, len(values), 256):
        out[row : row + 256] = np.rint(np.clip((values[row : row + 256].astype(np.float64) - low) * scale, 0, 255))
    return out


@contextmanager
def _pixel_limit(what: str) -> Iterator[None]:
    """PIL's guard against decompression bombs set to our own limit, inside this block only."""
    with _pil_lock, warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="PIL")  # on metadata; what matters is an error or a note
        warnings.simplefilter("error", PIL.Image.DecompressionBombWarning)
        before, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, MAX_PIXELS
        try:
            yield
        except (PIL.Image.DecompressionBombError, PIL.Image.DecompressionBombWarning) as error:
            raise _too_large(what) from error
        finally:
            PIL.Image.MAX_IMAGE_PIXELS = before


def _too_large(what: str) -> InputError:
    return InputError(f"{what} has more than {MAX_PIXELS // 10**9} gigapixel: cut it into tiles or reduce it")


def damaged(what: str, error: BaseException) -> InputError:
    """The error for a file whose content cannot be unpacked, with the decoder's own words."""
    return InputError(f"{what} is damaged or cut short ({_one_line(error)}): copy or download it again")


def _one_line(error: BaseException) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__
