"""How a saved result refers to its photographs, so that they are found again: by relative and absolute paths."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from zpm2.files.keys import fingerprint
from zpm2.files.record import destination


def absolute(path: str | None) -> str | None:
    """The absolute path of a file. Anything else, such as GDAL's name for a page of a TIFF, stays as it
    is."""
    return os.path.abspath(path) if path is not None and os.path.exists(path) else path


def photo_reference(path: str | None, folder: Path) -> dict[str, str | None]:
    """How a result in `folder` names a photograph: `path` (absolute), `relative_path` (from the folder, or from its
    `record.destination`, with /, null on another drive) and `content` (`keys.fingerprint`). The last two are null where
    there is no such file."""
    if path is None or not os.path.exists(path):
        return {"path": path, "relative_path": None, "content": None}
    full = os.path.abspath(path)
    real = Path(os.path.realpath(os.path.dirname(full)), os.path.basename(full))
    try:
        relative = Path(os.path.relpath(real, os.path.realpath(destination(folder)))).as_posix()
    except ValueError:  # another drive
        relative = None
    return {"path": full, "relative_path": relative, "content": _content(full)}


def find_photo(values: Mapping[str, object], folder: Path) -> str | None:
    """The path of the photograph of a `photo_reference`, for a result that now lies in `folder`.

    The photograph is looked for relative to that folder, then at its absolute path. A file with the same content is
    preferred to one that only has the same name. If neither exists, the absolute path is returned. `TypeError` or
    `KeyError` for malformed values.
    """
    path, relative = values["path"], values.get("relative_path")
    if not isinstance(path, str | None) or not isinstance(relative, str | None):
        raise TypeError("path is not text")
    if path is None or relative is None:
        return path
    places = [os.path.abspath(os.path.join(folder, relative)), path]
    there = [file for file in places if os.path.isfile(file)]
    same = [file for file in there if _content(file) == values.get("content")]
    return next(iter([*same, *there, path]))


def has_content(values: Mapping[str, object], file: str | Path) -> bool:
    """Whether a file has the content of a `photo_reference`; true for references without content."""
    return values.get("content") in (None, _content(file))


def are_swapped(sides: Sequence[Mapping[str, object]], files: Sequence[str | Path]) -> bool:
    """Whether left and right were exchanged: each of two files has the content of the other side's photograph."""
    contents = [_content(file) for file in files]
    noted = [side.get("content") for side in sides]
    return None not in noted and noted[0] != noted[1] and contents == noted[::-1]


def _content(file: str | Path) -> str | None:
    try:
        return fingerprint(file)
    except (OSError, ValueError):
        return None
