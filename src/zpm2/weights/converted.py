"""Models converted from weights and kept in the cache: a folder with a list of its files, checked at each use."""

import json
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from zpm2.errors import WeightsError
from zpm2.files.reading import read_json
from zpm2.weights.manifest import entry
from zpm2.weights.store import cache_dir, sha256_of, writing

LIST = "files.json"  # name -> [bytes, sha256]; written last

_log = logging.getLogger(__name__)


def converted(name: str, key: str, convert: Callable[[Path], None]) -> Path:
    """The folder with what `convert` makes of the weights `name`, made now unless it is there and whole.

    `key` tells conversions apart (the weights' hash, the converter's version); a new key is a new folder. `convert`
    gets an empty folder. Size and hash of each file are checked; what lies there damaged, half-made or without its list
    is replaced, and a warning says so. `WeightsError` where the cache cannot be written.
    """
    from zpm2.files.record import remove_leftovers, temporary_folder  # here, as zpm2.formats loads OpenCV

    item = entry(name)
    folder = cache_dir() / "converted" / f"{item.name}-{key}"
    flaw = _flaw(folder)
    if flaw is None:
        return folder
    if os.path.lexists(folder):
        _log.warning("%s %s: converting %s again", folder, flaw, item.name)
    with writing(item):
        folder.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(folder.parent)
        with temporary_folder(folder.parent) as part:
            new = part / "new"
            new.mkdir()
            convert(new)
            (new / LIST).write_text(json.dumps(_files(new)), encoding="utf-8")
            if os.path.lexists(folder) and _flaw(folder) is not None:
                os.rename(folder, part / "old")
            with suppress(OSError):  # not empty: another process was faster, and its files are as good
                os.rename(new, folder)
    flaw = _flaw(folder)
    if flaw is not None:
        raise WeightsError(f"the converted {item.name} cannot be kept, as {folder} {flaw}: remove it")
    return folder


def _flaw(folder: Path) -> str | None:
    """How a folder differs from what a conversion left, or None."""
    try:
        listed = read_json(folder / LIST)
        if not listed or not isinstance(listed, dict):
            return f"has a damaged {LIST}"
        there = _files(folder)
    except NotADirectoryError:
        return "is no folder"
    except FileNotFoundError:
        return f"has no {LIST}"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    except ValueError:
        return f"has a damaged {LIST}"
    wrong = [name for name, values in listed.items() if there.get(name) != values]
    return f"has a missing or damaged file {wrong[0]}" if wrong else None


def _files(folder: Path) -> dict[str, list[int | str]]:
    """Size and sha256 of the files of a folder, but for their list."""
    paths = sorted(path for path in folder.iterdir() if path.is_file() and path.name != LIST)
    return {path.name: [path.stat().st_size, sha256_of(path)] for path in paths}
