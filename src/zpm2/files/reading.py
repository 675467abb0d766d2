"""Files read safely: bytes, text, JSON, TOML and numpy arrays, with two kinds of error.

Whatever the libraries raise, the errors are `OSError` if the system cannot read a file, and `ValueError` if its content
is wrong. The caller, who knows what the file is for, turns them into a `Zpm2Error`. A size that a file declares is
checked against the length of the file before it is used.
"""

import errno
import gzip
import io
import json
import math
import os
import stat
import tokenize
import tomllib
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zpm2 import memory

# what values of a foreign shape raise where they are taken for ours: no object, no such member, no number, too large
WRONG = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError)
MAX_UNPACKED_BYTES = 2**25  # bytes that a packed file may hold: those that we read hold a few matrices, or a usual tile
MAX_PACKING = 40  # times its packed length that a file may hold
MAX_DIGITS = 300  # of a whole number, a longer one does not fit into a double
_NPY = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def regular(path: Path) -> Path:
    """The path, if it is a regular file whose name is valid UTF-8.

    Otherwise `OSError`: reading a pipe or a device might wait or go on for ever.
    """
    try:
        str(path).encode()
        mode = os.stat(path).st_mode
    except UnicodeEncodeError as error:
        raise OSError(errno.EILSEQ, "its name is not UTF-8, rename it") from error
    except ValueError as error:  # a NUL
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)) from error
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is not a regular file, copy its content into one")
    return path


def read_bytes(path: Path) -> bytes:
    """The whole content of a file; `OSError` if it is larger than the memory budget."""
    if (length := os.stat(regular(path)).st_size) > (most := memory.budget()):
        text = f"it has {memory.in_words(length)}, more than the {memory.in_words(most)} of memory: raise --max-memory"
        raise OSError(errno.EFBIG, text)
    return path.read_bytes()


def read_text(path: Path) -> str:
    """A file of UTF-8, with or without a byte order mark."""
    return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: Path) -> Any:
    """The value in a JSON file."""
    return parse_json(read_bytes(path))


def parse_json(content: bytes) -> Any:
    """The value of a JSON text. Its whole numbers can be made floats, as none has more than 300 digits."""
    try:
        return json.loads(content, parse_int=_whole)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def read_toml(path: Path) -> dict[str, Any]:
    """The table in a TOML file."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def unpack_gzip(path: Path) -> bytes:
    """The content of a .gz file: up to `MAX_UNPACKED_BYTES` bytes, or `MAX_PACKING` times its length.

    Texts of numbers never compress that well.
    """
    packed = read_bytes(path)
    most = max(MAX_UNPACKED_BYTES, MAX_PACKING * len(packed))
    with gzip.open(io.BytesIO(packed)) as file:
        try:
            content = file.read(most + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise ValueError("it is damaged or not a gzip file") from error
    if len(content) > most:
        raise ValueError(f"it holds more than {most // 2**20} MB")
    return content


def read_array(path: Path) -> NDArray[np.generic]:
    """The array of an .npy file, read-only."""
    return _array(read_bytes(path))


def read_arrays(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of an .npz file by name, read-only; together they may have `MAX_UNPACKED_BYTES` bytes."""
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            members = file.infolist()
            declared = sum(member.file_size for member in members)  # no more than this is ever unpacked
            if declared > MAX_UNPACKED_BYTES:
                raise ValueError(f"it holds more than {MAX_UNPACKED_BYTES // 2**20} MB")
            return {member.filename.removesuffix(".npy"): _array(file.read(member)) for member in members}
    except (OSError, EOFError, LookupError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError("it is damaged or not an .npz file") from error


def _array(content: bytes) -> NDArray[np.generic]:
    """An array as `numpy.save` writes it, without a copy."""
    stream = io.BytesIO(content)
    try:
        header = _NPY.get(np.lib.format.read_magic(stream))
        if header is None:
            raise ValueError("it is of an unknown version of .npy")
        shape, by_columns, kind = header(stream)
    except (SyntaxError, TypeError, tokenize.TokenError, MemoryError, RecursionError, OverflowError) as error:
        raise ValueError("it does not have the header of an .npy file") from error
    if kind.hasobject or not kind.itemsize or min(shape, default=0) < 0:
        raise ValueError(f"it holds {kind} of shape {shape}, not numbers")
    if math.prod(shape) * kind.itemsize != len(content) - stream.tell():
        raise ValueError(f"its length is not that of {kind} of shape {shape}")
    values = np.frombuffer(content, kind, offset=stream.tell()) if math.prod(shape) else np.empty(0, kind)
    return values.reshape(shape, order="F" if by_columns else "C")


def _whole(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"it has a number of {len(digits)} digits")
    return int(digits)
