"""Where results go: a folder for each pair or group, on a disk or in a store that fsspec knows.

`pair.json` (`group.json`) is written last and removed first, so a pair is finished where it is there. It holds the
pair's row of the index and the key of what it was made from.
"""

import contextlib
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from zpm2.batch import remote
from zpm2.batch.entries import Kind
from zpm2.batch.tables import Value
from zpm2.errors import InputError, OutputError
from zpm2.files.reading import WRONG, parse_json, read_bytes
from zpm2.files.record import remove_made, remove_own
from zpm2.files.writing import atomic_write, claim

INDEX = "index.parquet"
DONE, FAILED, MISSING = "done", "failed", "missing"


@dataclass(frozen=True)
class Row:
    """What became of a pair, or of a group."""

    name: str
    status: str  # `DONE` or `FAILED`
    reason: str | None = None  # why it failed
    seconds: float = 0.0
    found: Mapping[str, Value] = field(default_factory=dict)  # by the columns of its command

    def document(self, key: str, kind: Kind) -> bytes:
        """The content of `pair.json`, or `group.json`."""
        values = {"schema": _schema(kind), "key": key, kind: self.name, "status": self.status, "reason": self.reason}
        return json.dumps({**values, "seconds": round(self.seconds, 3), "found": dict(self.found)}).encode()


def read_row(content: bytes, key: str, kind: Kind) -> Row | None:
    """The row in a `pair.json` that was made with that key; None for another one, and for a damaged file."""
    try:
        values = parse_json(content)
        if values["schema"] != _schema(kind) or values["key"] != key or values["status"] not in (DONE, FAILED):
            return None
        reason = None if values["reason"] is None else str(values["reason"])
        return Row(str(values[kind]), values["status"], reason, float(values["seconds"]), dict(values["found"]))
    except WRONG:
        return None


class Results(Protocol):
    """A place for results."""

    def row(self, name: str, key: str) -> Row | None:
        """The row of a pair that is finished and was made with that key."""
        ...

    def save(self, row: Row, key: str, write: Callable[[Path], object] | None) -> None:
        """Fills the folder of a pair anew: by `write`, or, where it is None, with its row alone. Errors are those of
        `write`, and `OutputError`."""
        ...

    def tidy(self, name: str) -> None:
        """Removes what a process that ended in its work left in the folder of a pair."""
        ...

    def folder(self, name: str) -> Path | None:
        """The folder of a pair, for one that keeps there what it has finished; None in a store."""
        ...


class LocalResults:
    """Results on a disk. A pair's folder has a record of its own (`files.record`), so that it costs as much in a folder
    of a million pairs as in one of ten, and processes that share the folder do not meet."""

    def __init__(self, out: str | Path, kind: Kind = "pair") -> None:
        self.place, self.kind, self.file = Path(out) / f"{kind}s", kind, f"{kind}.json"

    def row(self, name: str, key: str) -> Row | None:
        """See `Results`."""
        try:
            return read_row(read_bytes(self.place / name / self.file), key, self.kind)
        except OSError:
            return None

    def save(self, row: Row, key: str, write: Callable[[Path], object] | None) -> None:
        """See `Results`."""
        folder = claim(self.place / row.name, [self.file])
        remove_own(folder / self.file)
        remove_made(folder)
        if write is not None:
            write(folder)
        atomic_write(folder / self.file, row.document(key, self.kind))

    def tidy(self, name: str) -> None:
        """See `Results`."""
        if (self.place / name).is_dir():
            with contextlib.suppress(OutputError):  # the next run says it
                claim(self.place / name, [])

    def folder(self, name: str) -> Path | None:
        """See `Results`."""
        return claim(self.place / name, [self.file])


class RemoteResults:
    """Results in a store: made in a temporary folder here, and then copied."""

    def __init__(self, out: str, kind: Kind = "pair") -> None:
        self.place, self.kind = f"{out.rstrip('/')}/{kind}s", kind

    def row(self, name: str, key: str) -> Row | None:
        """See `Results`."""
        try:
            return read_row(remote.read(f"{self.place}/{name}/{self.kind}.json"), key, self.kind)
        except InputError:
            return None

    def save(self, row: Row, key: str, write: Callable[[Path], object] | None) -> None:
        """See `Results`."""
        place = f"{self.place}/{row.name}"
        with tempfile.TemporaryDirectory(prefix="zpm2-") as made:
            folder = Path(made) / row.name
            folder.mkdir()
            if write is not None:
                write(folder)
            remote.remove(place)  # an earlier result
            for file in sorted(folder.rglob("*")):
                name = file.relative_to(folder)
                if file.is_file() and not name.parts[0].startswith("."):
                    remote.write(f"{place}/{name.as_posix()}", file.read_bytes())
        remote.write(f"{place}/{self.kind}.json", row.document(key, self.kind))

    def tidy(self, name: str) -> None:
        """Nothing is left."""

    def folder(self, name: str) -> Path | None:
        """See `Results`."""
        return None


class NoResults:
    """For entries whose command keeps its results itself."""

    def row(self, name: str, key: str) -> Row | None:
        """See `Results`."""
        return None

    def save(self, row: Row, key: str, write: Callable[[Path], object] | None) -> None:
        """Nothing."""

    def tidy(self, name: str) -> None:
        """Nothing."""

    def folder(self, name: str) -> Path | None:
        """See `Results`."""
        return None


def results_in(out: str, kind: Kind) -> Results:
    """The place of that path or address."""
    if kind == "tile":
        return NoResults()
    return RemoteResults(out, kind) if remote.is_address(out) else LocalResults(out, kind)


def _schema(kind: Kind) -> str:
    return f"zpm2-batch-{kind}/1"
