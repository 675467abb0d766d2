"""Whether what an earlier run left may be taken: content of the inputs, configuration and code are the same."""

import functools
import hashlib
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from zpm2.files.reading import regular

BLOCK = 2**16  # bytes
BLOCKS = 64  # of a file that are looked at: all of up to 4 MB


def key(files: Iterable[str | Path], *more: Any) -> str:
    """A name for what these input files and `more` (plain values: configuration, names) give with this code.

    A file that was replaced, touched, or is missing gives another key; where it lies does not matter. Weights are part
    of the code, as the manifest in it holds their sha256 and no other file is taken for them.
    """
    text = json.dumps([code(), [stamp(file) for file in files], *more], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def stamp(file: str | Path) -> tuple[str, int] | None:
    """What a file holds and when it was written (ns); None where it is missing."""
    try:
        return fingerprint(file), os.stat(file).st_mtime_ns
    except OSError:
        return None


def fingerprint(file: str | Path) -> str:
    """The size of a file and a hash of its content: of all of it up to 4 MB, else of 64 blocks spread over it evenly,
    so that gigabytes cost no time. `OSError` where it cannot be read."""
    digest = hashlib.sha256()
    with regular(Path(file)).open("rb") as opened:
        size = opened.seek(0, os.SEEK_END)
        last = max(size - BLOCK, 0)
        count = min(BLOCKS, -(-size // BLOCK))
        for k in range(count):
            opened.seek(last * k // max(count - 1, 1))
            digest.update(opened.read(BLOCK))
    return f"{size}-{digest.hexdigest()[:32]}"


@functools.cache
def code() -> str:
    """A hash of the source files of this package, worked out once in a process."""
    return _code_in(Path(__file__).parents[1])


def code_of(module: str) -> str:
    """The same of the package that an imported module belongs to; of its one file, where it is in no package. Nothing
    for a module without files."""
    found = sys.modules.get(module.partition(".")[0])
    places = [] if found is None else [*getattr(found, "__path__", [])] or [getattr(found, "__file__", None) or ""]
    return "-".join(_code_in(Path(place)) for place in sorted(places) if place)


def _code_in(place: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
        digest.update(f"{file.relative_to(place).as_posix()}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]
