"""Checks of a photograph (file, shape, size), and the errors that say why it cannot be used."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.errors import InputError
from zpm2.files.reading import regular
from zpm2.model import Image

MIN_SIDE = 32  # px, below this there is nothing to segment
MAX_PIXELS = 1_000_000_000  # px, beyond this a file is refused before it is unpacked
PACKED = ("BMP", "GIF", "JPEG", "PNG")  # formats in which a pixel takes at least a known part of a byte
MAX_PER_BYTE = 8 * 1032  # px of one bit, at the best compression of deflate


def check(values: NDArray[np.generic], what: str) -> None:
    """`InputError` for an array whose shape or type is not that of a photograph."""
    shape = " x ".join(map(str, values.shape))
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (1, 3, 4)):
        hint = ": move the channels last" if values.ndim == 3 and values.shape[0] in (1, 3, 4) else ""
        raise InputError(f"{what}: expected (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), got {shape or 'a scalar'}{hint}")
    height, width = values.shape[:2]
    check_sides(width, height, what)
    if values.dtype.kind not in "buif":
        raise InputError(f"{what}: expected bool, integer or float values, got {values.dtype}")


def check_image(image: Image, what: str) -> None:
    """`InputError` for an `Image` whose arrays are not those of a photograph."""
    rgb, valid = image.rgb, image.valid
    if not isinstance(rgb, np.ndarray) or np.ma.isMaskedArray(rgb):
        raise InputError(f"{what}: expected an Image with rgb (h, w, 3) uint8, got a {type(rgb).__name__}")
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
        raise InputError(f"{what}: expected an Image with rgb (h, w, 3) uint8, got {_kind(rgb)}: give the array itself")
    check_sides(image.width, image.height, what)
    if valid is None:
        return
    if valid.shape != rgb.shape[:2] or valid.dtype != np.bool_:
        raise InputError(
            f"{what}: expected an Image with valid {image.height} x {image.width} bool, got {_kind(valid)}"
        )
    if not valid.any():
        raise no_data(what)


def check_sides(width: int, height: int, what: str) -> None:
    """`InputError` for a photograph that is too small for segmentation."""
    if min(height, width) < MIN_SIDE:
        raise InputError(f"{what} is {width} x {height} px: each side must have at least {MIN_SIDE} px")


@contextmanager
def opened_file(path: Path, what: str) -> Iterator[BinaryIO]:
    """The file, open for reading; `InputError` where it is empty or cannot be opened."""
    try:
        with regular(path).open("rb") as file:
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


def check_length(width: int, height: int, kind: str, path: str | Path, what: str) -> None:
    """`InputError` for a file of a format in `PACKED` that is too short for the pixels that it declares."""
    if kind in PACKED and width * height > MAX_PER_BYTE * (length := os.stat(path).st_size):
        raise damaged(what, ValueError(f"{width} x {height} px in {length} bytes"))


def check_memory(width: int, height: int, each: float, what: str) -> None:
    """`InputError` for a photograph that does not fit into the memory budget with `each` bytes a pixel."""
    memory.refuse_above(width * height * each, f"{what} ({width} x {height} px)", "reduce it, or raise --max-memory")


def no_memory(what: str) -> InputError:
    """The error for a photograph that does not fit into memory."""
    return InputError(f"{what} needs more memory than there is: match it in tiles, or reduce it")


def no_data(what: str) -> InputError:
    """The error for a photograph without any pixel that holds data."""
    return InputError(f"{what} has no pixel with data: check its nodata value, its mask or its alpha band")


def too_large(what: str) -> InputError:
    """The error for a photograph of more than `MAX_PIXELS` that must be read at once."""
    return InputError(f"{what} has more than {MAX_PIXELS // 10**9} gigapixel: match it in tiles, or reduce it")


def unknown_format(what: str) -> InputError:
    """The error for a file in a format that no library reads."""
    return InputError(f"{what} is not a picture in a known format: give a PNG, JPEG or TIFF file")


def damaged(what: str, error: BaseException) -> InputError:
    """The error for a file whose content cannot be unpacked, with the decoder's message."""
    return InputError(f"{what} is damaged or cut short ({_one_line(error)}): copy or download it again")


def _kind(values: NDArray[np.generic]) -> str:
    return f"{' x '.join(map(str, values.shape))} {values.dtype}"


def _one_line(error: BaseException) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__
