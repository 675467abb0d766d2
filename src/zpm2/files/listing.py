"""Files and folders of the user: checks that they exist, lists them in a fixed order, reads small text files."""

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zpm2.errors import InputError
from zpm2.files import reading

_RUNS = re.compile(r"[0-9]+|[^0-9]+")


def existing(*candidates: Path) -> Path:
    """The first of `candidates` that exists; `InputError` names every one that was looked for."""
    for path in candidates:
        if os.path.exists(path):  # False for names that are too long or contain a NUL
            return path
    looked = " and ".join(str(path) for path in candidates)
    raise InputError(f"looked for {looked}, not there: check the path, or complete the download")


def folders(folder: Path) -> list[Path]:
    """The sub-folders in natural order, hidden ones left out."""
    return sorted((path for path in folder.iterdir() if path.is_dir() and path.name[0] != "."), key=natural)


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """A name for each file: its own, or, if two files have the same, its path below the folder common to all."""
    names = [path.name for path in paths]
    if len(set(names)) == len(names):
        return names
    whole = [Path(os.path.abspath(path)) for path in paths]
    try:
        common = os.path.commonpath([path.parent for path in whole])
    except ValueError:  # on several drives of Windows
        return ["/".join([path.drive.strip(":\\").replace("\\", "/"), *path.parts[1:]]) for path in whole]
    return [path.relative_to(common).as_posix() for path in whole]


def distinct_stems(paths: Sequence[Path]) -> list[str]:
    """A folder name for each file: its name without the ending; with it, or with a number, where two would be equal.

    >>> distinct_stems([Path("a/1.png"), Path("a/2.png"), Path("b/2.png")])
    ['1', '2', '2_2']
    """
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems) and len({path.name for path in paths}) == len(paths):
        stems = [path.name.replace(".", "_") for path in paths]
    found: list[str] = []
    for stem in stems:
        name, count = stem, 1
        while name in found:
            count += 1
            name = f"{stem}_{count}"
        found.append(name)
    return found


def natural(path: Path) -> tuple[list[tuple[bool, int, str]], str]:
    """Sort key that puts scan9 before scan10. Names that only differ in leading zeros are sorted by character."""
    runs = _RUNS.findall(path.name)
    return [(False, int(run), "") if run[0] in "0123456789" else (True, 0, run) for run in runs], path.name


def text(path: Path) -> str:
    """The content of a text file; `InputError` where it is missing or no UTF-8."""
    try:
        return reading.read_text(existing(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a readable text file: copy or download it again") from error


def json_file(path: Path) -> Any:
    """The content of a JSON file; `InputError` says in which line it breaks."""
    try:
        return reading.parse_json(text(path).encode())
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not valid JSON: {error.msg} in line {error.lineno}: correct the file") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON, {error}: correct the file") from error
