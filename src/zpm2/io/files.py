"""Files out: whole or not at all, and into a folder that was seen to be writable before the work began."""

import contextlib
import errno
import os
import tempfile
import uuid
from collections.abc import Iterable
from pathlib import Path

from zpm2.errors import OutputError


def atomic_write(path: str | Path, content: bytes | str) -> Path:
    """Writes `content` (text as UTF-8) so that `path` holds all of it, or what it held before.

    The bytes go to a temporary file in the same folder, which then takes the name. Returns the path. `OutputError`
    when the folder does not exist or is not writable, `path` is a folder, or the disk is full; no temporary file stays.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    temporary = path.with_name(f".{uuid.uuid4().hex}.part")
    try:
        with open(temporary, "xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {why(error, path)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()  # gone already, unless something went wrong
    return path


def output_folder(path: str | Path, inputs: Iterable[str | Path] = ()) -> Path:
    """The folder for results, created where it is missing and tried out, so that a long run cannot fail at its end.

    `OutputError` when `path` is a file (one of `inputs`, for instance), cannot be created, or cannot be written into.
    """
    path = Path(path)
    for source in inputs:
        if _same(path, Path(source)):
            raise OutputError(f"output folder {path} is one of the input files: give another folder")
    try:
        if path.exists() and not path.is_dir():
            raise OutputError(f"output folder {path} is a file: give another folder")
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(b"\0")
    except OSError as error:
        raise OutputError(f"cannot write into output folder {path}: {why(error, path)}") from error
    return path


def _same(a: Path, b: Path) -> bool:
    try:
        return a.samefile(b)
    except OSError:
        return False


def why(error: OSError, path: Path) -> str:
    """Why `path` could not be written and what to do, for the end of an `OutputError`'s line."""
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return "permission denied; give a folder that you may write to"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the disk is full; free some space"
    if error.errno in (errno.ENOTDIR, errno.EEXIST):
        return "a part of the path is a file, not a folder; give another path"
    if error.errno == errno.EISDIR or path.is_dir():
        return "there is a folder of that name; give another path"
    if error.errno == errno.ENOENT and path.parent.is_dir():
        return "it cannot be created there; give another path"
    if error.errno == errno.ENOENT:
        return f"the folder {path.parent} does not exist; create it first"
    return (error.strerror or str(error)).lower()
