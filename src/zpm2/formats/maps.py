"""Disparity and depth maps, read from .pfm, .png and .npy files as one float per pixel."""

import re
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.reading import read_array, read_bytes, regular
from zpm2.photos.checks import check_length, check_memory
from zpm2.photos.pictures import DAMAGE

_PFM_HEADER = re.compile(rb"(P[fF])\s+(\d{1,6})\s+(\d{1,6})\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)[ \t]*\r?\n")
BYTES_PER_PX = 12  # bytes a pixel of a PNG: as it is stored, and twice as a float
MAX_OTHER_SIGN = 0.05  # share of the known values that may have the opposite sign
_ONE_BAND = ("L", "I", "I;16", "I;16B", "I;16L")  # PIL's modes of 8- and 16-bit grey


def read_map(path: str | Path, size: tuple[int, int] | None = None, scale: float = 1.0) -> NDArray[np.float32]:
    """(h, w) the values of a map, depths for example, divided by `scale`; NaN where nothing is known.

    path: a .pfm of one band (its scale gives the byte order only, as everywhere), a .png of 8 or 16 bit and one band
        (KITTI: scale 256; depth in mm: 1000), or a .npy of shape (h, w). size: (width, height) px that the image has,
        None for any.

    Unknown are 0, infinity, NaN and negative values. A map without positive values holds depths along -z; their sign is
    dropped. `InputError` names the file when it is missing, damaged, of another kind or size, or without a known
    value.
    """
    values = _read(Path(path), size)
    if not (values > 0).any():
        values *= -1
    values[~(values > 0)] = np.nan
    values /= np.float32(scale)
    return values


def read_disparity(
    path: str | Path, size: tuple[int, int] | None = None, scale: float = 1.0, sign: int = 1
) -> NDArray[np.float32]:
    """(h, w) px, left x - right x, of a map of the kinds that `read_map` knows; NaN where nothing is known.

    sign: 1, the disparity is value / scale, negative where the right photograph comes first; -1 for a file that stores
        the opposite; 0 for files that store either, of pairs whose left photograph is known to come first.

    Unknown are 0, infinity and NaN, and values of the opposite sign where they are few or a marker for unknown (-1,
    or one value far below 0). `InputError` as for `read_map`, and where more than 5 % have the opposite sign.
    """
    values = _read(Path(path), size)
    below, above = values < 0, values > 0
    if above.any() and below.any():
        lowest = values[below].min()
        if lowest == values[below].max() and (lowest == -1 or lowest < -values[above].max()):
            below[:] = False
    few, most = sorted((below, above), key=np.count_nonzero)
    if np.count_nonzero(few) > MAX_OTHER_SIGN * np.count_nonzero(below | above):
        raise InputError(
            f"map {path} has {below.sum()} values below 0 and {above.sum()} above: disparities have one sign; give the "
            "map of this pair, with 0 where nothing is known"
        )
    values[~most] = np.nan
    values /= np.float32(scale * (sign or (-1 if most is below else 1)))
    return values


def _read(path: Path, size: tuple[int, int] | None) -> NDArray[np.float32]:
    """The numbers of the file, NaN where they are not finite. `InputError` where all are 0 or not finite."""
    read = {".pfm": _read_pfm, ".png": _read_png, ".npy": _read_npy}.get(path.suffix.lower())
    if read is None:
        raise InputError(f"map {path} must be a .pfm, .png or .npy file: convert it")
    try:
        found = read(path)
    except FileNotFoundError as error:
        raise InputError(f"map {path} does not exist: check the path, or download it again") from error
    except (*DAMAGE, PIL.Image.DecompressionBombError) as error:
        raise InputError(f"map {path} is damaged or not a {path.suffix} file: copy or download it again") from error
    except MemoryError as error:
        raise InputError(f"map {path} needs more memory than there is: give a smaller one") from error
    height, width = found.shape
    if size is not None and (width, height) != tuple(size):
        raise InputError(
            f"map {path} has {width} x {height} px, its image {size[0]} x {size[1]} px: give the map of this image"
        )
    values = np.array(found, np.float32, order="C")
    values[~np.isfinite(values)] = np.nan
    if not (np.nan_to_num(values) != 0).any():
        raise InputError(f"map {path} holds no known value, all of it is 0 or not finite: give another one")
    return values


def _read_pfm(path: Path) -> NDArray[np.float32]:
    content = read_bytes(path)
    header = _PFM_HEADER.match(content)
    if header is None:
        raise ValueError("no PFM header")
    if header[1] == b"PF":
        raise InputError(f"map {path} has 3 bands, as optical flow has: give a disparity or depth map of one band")
    width, height = int(header[2]), int(header[3])
    if len(content) - header.end() != 4 * width * height or not width * height:
        raise ValueError("cut short")
    order = "<f4" if float(header[4]) < 0 else ">f4"
    rows = np.frombuffer(content, order, offset=header.end()).reshape(height, width)
    return rows[::-1]  # the bottom row comes first


def _read_png(path: Path) -> NDArray[np.generic]:
    with PIL.Image.open(regular(path), formats=["PNG"]) as picture:
        check_length(*picture.size, "PNG", path, f"map {path}")
        check_memory(*picture.size, BYTES_PER_PX, f"map {path}")
        if picture.mode not in _ONE_BAND:
            raise InputError(f"map {path} is a PNG of mode {picture.mode}: give one band of 8 or 16 bit")
        return np.asarray(picture)


def _read_npy(path: Path) -> NDArray[np.generic]:
    values = read_array(path)
    if values.ndim != 2 or values.dtype.kind not in "fiu" or not values.size:
        raise InputError(f"map {path} holds {values.dtype} of shape {values.shape}: give numbers of shape (h, w)")
    return values
