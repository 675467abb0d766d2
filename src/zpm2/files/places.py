"""Where the photographs of a saved result are: as seen from its folder, and as an absolute path."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from zpm2.files.keys import fingerprint


def absolute(path: str | None) -> str | None:
    """The path from the root, so that it holds wherever the process goes. What is no file's path, such as GDAL's name
    for a part of a file, stays as it is."""
    return os.path.abspath(path) if path is not None and os.path.exists(path) else path


def place(path: str | None, folder: Path) -> dict[str, str | None]:
    """What a result in `folder` says of a photograph: `path` (absolute), `relative_path` (from the folder, with /, null
    on another drive) and `content` (`keys.fingerprint`); the last two null where there is no such file."""
    if path is None or not os.path.exists(path):
        return {"path": path, "relative_path": None, "content": None}
    full = os.path.abspath(path)
    real = Path(os.path.realpath(os.path.dirname(full)), os.path.basename(full))
    try:
        relative = Path(os.path.relpath(real, os.path.realpath(folder))).as_posix()
    except ValueError:  # another drive
        relative = None
    return {"path": full, "relative_path": relative, "content": _content(full)}


def find(values: Mapping[str, Any], folder: Path) -> str | None:
    """The photograph that `place` described, now that the result lies in `folder`: as seen from there, else at its
    absolute place. What holds what it held comes before what only has its name; where neither is, the absolute path.
    `TypeError` or `KeyError` for values of another kind."""
    path, relative = values["path"], values.get("relative_path")
    if not all(text is None or isinstance(text, str) for text in (path, relative)):
        raise TypeError("path is no text")
    if path is None or relative is None:
        return path
    places = [os.path.abspath(os.path.join(folder, relative)), path]
    there = [file for file in places if os.path.isfile(file)]
    same = [file for file in there if _content(file) == values.get("content")]
    return next(iter([*same, *there, path]))


def is_content(values: Mapping[str, Any], file: str | Path) -> bool:
    """Whether a file holds what the photograph held that `place` described; true where nobody noted it."""
    return values.get("content") in (None, _content(file))


def exchanged(sides: Sequence[Mapping[str, Any]], files: Sequence[str | Path]) -> bool:
    """Whether each of two files holds what the photograph of the other side held."""
    contents = [_content(file) for file in files]
    noted = [side.get("content") for side in sides]
    return None not in noted and noted[0] != noted[1] and contents == noted[::-1]


def _content(file: str | Path) -> str | None:
    try:
        return fingerprint(file)
    except (OSError, ValueError):
        return None
