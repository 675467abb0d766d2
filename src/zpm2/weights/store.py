"""The folders with weights, the user's own and the cache: finding, verifying and keeping files. No network.

The cache is `ZPM2_CACHE`, else the platform's cache folder for zpm2; weights lie in its subfolder `weights`. A file is
the right one when its size and sha256 agree with the manifest. To spare hashing gigabytes at each start, a marker
(`FILE.verified.json` in the cache) remembers path, size, modification time and hash of the copy that was verified
last; any difference means hashing again.
"""

import hashlib
import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from zpm2.errors import OutputError, WeightsError
from zpm2.files.reading import WRONG, read_json
from zpm2.weights.manifest import MANIFEST, Entry

Progress = Callable[[int, int], None]  # (bytes done, bytes in all)

_log = logging.getLogger(__name__)


class Status(NamedTuple):
    """One entry and where a file of its name and size lies (None: nowhere)."""

    entry: Entry
    path: Path | None


class BadCopy(Exception):
    """A file or download that differs from the manifest; the text says how."""


def cache_dir() -> Path:
    """The folder of downloaded copies. It need not exist yet."""
    root = os.environ.get("ZPM2_CACHE")
    if root:
        return Path(root).expanduser() / "weights"
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("zpm2")) / "weights"


def folders(directory: str | Path | None = None) -> list[Path]:
    """Where files are looked for, in order: `directory` (else `ZPM2_WEIGHTS`), then the cache.

    A folder that the user names and that does not exist raises `WeightsError`.
    """
    named = directory or os.environ.get("ZPM2_WEIGHTS")
    if not named:
        return [cache_dir()]
    folder = Path(named).expanduser()
    if not folder.is_dir():
        raise WeightsError(
            f"the weights folder {folder} does not exist: make it, or correct --weights-dir/ZPM2_WEIGHTS"
        )
    return [folder, cache_dir()]


def status(directory: str | Path | None = None) -> list[Status]:
    """Every entry of the manifest and where a file of its name and size lies. Nothing is hashed."""
    places = folders(directory)
    return [
        Status(item, next((p for p in (f / item.file for f in places) if _has_size(p, pinned(item).size)), None))
        for item in MANIFEST
    ]


def pinned(item: Entry) -> Entry:
    """The entry with the size and hash that its file in the cache had when it came there, where we know neither."""
    if item.hash_known:
        return item
    try:
        values = read_json(_pin_path(item))
        return replace(item, size=int(values["size"]), sha256=str(values["sha256"]))
    except OSError:
        return item
    except WRONG:
        raise WeightsError(f"{_pin_path(item)} is damaged: remove it and {item.file}, to fetch that again") from None


def pin(known: Entry) -> None:
    """Remember the size and hash of a file in the cache, where the manifest has neither."""
    from zpm2.files.writing import atomic_write

    with writing(known):
        atomic_write(_pin_path(known), json.dumps({"size": known.size, "sha256": known.sha256}))


def find(item: Entry, directory: str | Path | None = None, *, rehash: bool = False) -> Path | None:
    """The verified file of an entry in the user's folder or the cache, or None where there is none.

    A wrong file in the user's folder raises `WeightsError`. A wrong file in the cache does so under `rehash` (which
    also ignores markers); otherwise it is reported and passed over, so that it is fetched anew.
    """
    places = folders(directory)
    _sweep(cache_dir())
    for path in (folder / item.file for folder in places):
        try:
            if path.is_file():
                _check_known(item, path, rehash)
                return path
        except BadCopy as reason:
            if rehash or path.parent != cache_dir():
                raise WeightsError(f"{path} {reason}: replace it by {item.label}, or remove it") from None
            _log.warning("%s %s: fetching it again", path, reason)
        except OSError as error:
            raise WeightsError(f"cannot read {path}, the weights {item.name}: {error.strerror or error}") from error
    return None


def keep(item: Entry, chunks: Iterable[bytes], progress: Progress | None = None) -> Path:
    """Write a download into the cache under a temporary name, verify it, and give it its name in one step.

    `chunks` raises its own failures as `SourceError`, which passes through; an `OSError` here comes from the cache and
    becomes `WeightsError`. `BadCopy` if the bytes are not the manifest's. Nothing half-written stays behind.
    """
    from zpm2.files.record import temporary_folder  # here, as zpm2.formats loads OpenCV

    target = cache_dir() / item.file
    digest, done = hashlib.sha256(), 0
    with writing(item):
        target.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target.parent)
        with temporary_folder(target.parent) as folder:
            part = folder / item.file
            with part.open("xb") as file:
                for chunk in chunks:
                    done += len(chunk)
                    if done > item.size:
                        raise BadCopy(f"is longer than {item.size} bytes")
                    digest.update(chunk)
                    file.write(chunk)
                    if progress:
                        progress(done, item.size)
            _compare(item, done, digest.hexdigest())
            os.replace(part, target)
    _mark(item, target)
    return target


def _sweep(folder: Path) -> None:
    """Removes what killed runs left in the cache, if there is anything."""
    if any(folder.glob("*.part")):
        from zpm2.files.record import remove_leftovers  # here, as zpm2.formats loads OpenCV

        remove_leftovers(folder)


@contextmanager
def writing(item: Entry) -> Iterator[None]:
    """Turn the `OSError` of a cache that is full, read-only or not ours into a `WeightsError` with the way out."""
    try:
        yield
    except OSError as error:
        raise WeightsError(
            f"cannot write {item.name} into {cache_dir()}: {error.strerror or error}; free space there, point"
            f" ZPM2_CACHE to a folder that can be written, or put {item.label} by hand into a folder named by"
            " --weights-dir or ZPM2_WEIGHTS"
        ) from error


def _check_known(item: Entry, path: Path, rehash: bool) -> None:
    """`_check` against what is known. A file in the cache of which nothing is known is remembered as it is; the user's
    own copy of such a file is the user's word."""
    known = pinned(item)
    if item.hash_known or (path.parent == cache_dir() and known.hash_known):
        _check(known, path, rehash)
    elif path.parent == cache_dir():
        pin(replace(item, size=path.stat().st_size, sha256=sha256_of(path)))


def _check(item: Entry, path: Path, rehash: bool) -> None:
    """Raise `BadCopy` unless the file is the manifest's; hash it unless its marker still holds."""
    if not rehash and _marker(item) == _fingerprint(item, path):
        return
    size = path.stat().st_size
    _compare(item, size, sha256_of(path) if size == item.size else "")
    _mark(item, path)


def _compare(item: Entry, size: int, sha256: str) -> None:
    if size != item.size:
        raise BadCopy(f"has {size} bytes instead of {item.size}")
    if sha256 != item.sha256:
        raise BadCopy(f"has sha256 {sha256} instead of {item.sha256}")


def sha256_of(path: Path) -> str:
    """The file's sha256 in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _has_size(path: Path, size: int) -> bool:
    """Whether there is a file of that size, of any for 0."""
    return path.is_file() and size in (0, path.stat().st_size)


def _fingerprint(item: Entry, path: Path) -> dict[str, str | int]:
    stat = path.stat()
    return {"path": str(path.resolve()), "size": stat.st_size, "mtime_ns": stat.st_mtime_ns, "sha256": item.sha256}


def _pin_path(item: Entry) -> Path:
    return cache_dir() / f"{item.file}.pinned.json"


def _marker_path(item: Entry) -> Path:
    return cache_dir() / f"{item.file}.verified.json"


def _marker(item: Entry) -> object:
    try:
        return read_json(_marker_path(item))
    except (OSError, ValueError):
        return None


def _mark(item: Entry, path: Path) -> None:
    """Remember that this copy was verified. Where the cache cannot be written it is hashed at each start instead."""
    from zpm2.files.writing import atomic_write

    marker = _marker_path(item)
    try:
        marker.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(marker, json.dumps(_fingerprint(item, path)))
    except (OSError, OutputError) as error:
        _log.info("%s: %s is hashed at each start", error, path)
