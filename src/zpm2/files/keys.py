"""Resume keys: results of an earlier run are used again if inputs, configuration and code are the same."""

import functools
import hashlib
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from zpm2.files.reading import regular

BLOCK = 2**16  # bytes
BLOCKS = 64  # of a file that are looked at: all of up to 4 MB


def key(files: Iterable[str | Path], *more: object) -> str:
    """A key for the results of these input files, of `more` (plain values: configuration, names), and of this code.

    The key changes if a file is replaced, touched, or missing; the place of a file does not matter. The code covers the
    weights: it contains the manifest with their sha256, and no other file is accepted for them.
    """
    text = json.dumps([code(), [stamp(file) for file in files], *more], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def stamp(file: str | Path) -> tuple[str, int] | None:
    """Fingerprint of a file's content and the time when it was written (ns); None if it is missing."""
    try:
        return fingerprint(file), os.stat(file).st_mtime_ns
    except OSError:
        return None


def fingerprint(file: str | Path) -> str:
    """The size of a file and a hash of its content. `OSError` if it cannot be read.

    Up to 4 MB, all of the content is hashed; of larger files, 64 blocks spread evenly, so that gigabytes cost no time.
    """
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
    """A hash of the source files of this package, computed once per process."""
    return _code_in(Path(__file__).parents[1])


def code_of(module: str) -> str:
    """A hash of the source files of the package that an imported module belongs to.

    For a module outside any package, a hash of its file; empty for a module without files.
    """
    found = sys.modules.get(module.partition(".")[0])
    places = [] if found is None else [*getattr(found, "__path__", [])] or [getattr(found, "__file__", None) or ""]
    return "-".join(_code_in(Path(place)) for place in sorted(places) if place)


def _code_in(place: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
        digest.update(f"{file.relative_to(place).as_posix()}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]
