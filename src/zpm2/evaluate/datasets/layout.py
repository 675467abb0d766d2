"""Helpers of all loaders: pairs that must be there, names that are usable as paths."""

import re
from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.pairs import EvalPair
from zpm2.files.listing import natural
from zpm2.photos.listing import photographs


def together(*where: Path) -> list[str]:
    """The names of photographs in any of the folders, in natural order, so that one missing in a folder is noticed."""
    return sorted({path.name for folder in where for path in photographs(folder)}, key=lambda name: natural(Path(name)))


def found(pairs: Iterator[EvalPair], *looked: Path | str) -> Iterator[EvalPair]:
    """`pairs`, or an `InputError` that says what was looked for where there is none."""
    first = next(pairs, None)
    if first is None:
        what = " and ".join(str(path) for path in looked)
        raise InputError(f"looked for {what}, no pair found: complete the download, or give another root or split")
    yield first
    yield from pairs


def path_name(*parts: str) -> str:
    """Parts joined by '/', other characters than letters, digits, '.', '_' and '-' replaced by '_'.

    A path below any folder: empty parts are left out, and '..' becomes '__'.
    """
    clean = (_FOREIGN.sub("_", part) for part in parts)
    return "/".join("_" * len(part) if set(part) == {"."} else part for part in clean if part) or "_"


_FOREIGN = re.compile(r"[^A-Za-z0-9._-]")
