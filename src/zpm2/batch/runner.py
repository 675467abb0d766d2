"""A list by one call: what is finished is taken over, the rest is done, and all of it is in one index."""

import dataclasses
import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from zpm2.batch import remote
from zpm2.batch.commands import columns_of
from zpm2.batch.engines.engine import Engine
from zpm2.batch.engines.processes import Processes
from zpm2.batch.entries import Entry, to_csv
from zpm2.batch.group_list import read_groups
from zpm2.batch.job import Job, Task, tasks
from zpm2.batch.pair_list import part_of, read_pairs
from zpm2.batch.results import DONE, FAILED, INDEX, MISSING, Row, results_in
from zpm2.batch.supply import Supply
from zpm2.batch.tables import Columns, IndexTable, Value, joined, read_columns, read_note
from zpm2.errors import ConfigError, InputError
from zpm2.files import reading
from zpm2.files.writing import atomic_write, claim, results_folder
from zpm2.formats.parquet import require_pyarrow
from zpm2.runtime import Progress

SHARDS = "shards"
SCHEMA = "zpm2-batch-index/1"
FIRST, LAST = 10.0, 300.0  # s, between two states of the index, at the beginning and at most
SAY = 30.0  # s, between two lines about progress
STATE: Columns = {"status": "text", "reason": "text", "seconds": "float"}


@dataclass(frozen=True)
class BatchSummary:
    """What became of a list of pairs or groups, or of a shard of one."""

    pairs: int  # or groups
    done: int  # reused ones included
    reused: int  # from an earlier run
    failed: int
    seconds: float
    index: str  # path or address of the index
    complete: bool  # whether this is the index of all pairs of the list

    @property
    def missing(self) -> int:
        """Pairs that nobody has done yet."""
        return self.pairs - self.done - self.failed


def run(
    pairs: Sequence[Entry] | str | Path,
    job: Job,
    *,
    engine: Engine | None = None,
    shard: str | None = None,
    retries: int = 2,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> BatchSummary:
    """Do a job for each pair of a list, and write the index.

        zpm2.batch.run("pairs.csv", zpm2.batch.Job("out"), engine=zpm2.batch.Processes(4))

    pairs: of `read_pairs` or `pairs_of_folder`, or the place of a table for `read_pairs`; for the command tracks,
    groups of `read_groups` or `groups_of_folder`. What is said of pairs here holds for groups, too.

    A pair whose result is there, of the same photographs, settings and code, is not done again; one that failed is. A
    pair that fails is a row of the index with its reason. `retries`: how often a pair is tried again whose process died
    or that failed by no fault of its input. shard: "i/n", the i-th of n parts; the last one to end writes the index of
    all. engine: one process if None.

    Start it under `if __name__ == "__main__":` in a script, as its processes import the script. `ConfigError`,
    `OutputError` where results cannot be written, and errors that concern all pairs, such as `WeightsError`.
    """
    if retries < 0:
        raise ConfigError(f"retries is {retries}: give 0 or more")
    listed = _checked(pairs, job)
    start = time.monotonic()
    chosen = range(len(listed)) if shard is None else part_of(len(listed), shard)
    engine = engine or Processes(1)
    with _Index(job, listed, chosen, shard) as index:
        progress("list", 0.0)
        todo = index.take(tasks(job, [listed[row] for row in chosen]))
        progress("list", 1.0)
        if index.reused:
            say(f"{index.reused} of {len(chosen)} {job.kind}s are finished already")
        if todo:
            tell = _Teller(len(todo), f"{job.kind}s", progress, say)
            with closing(engine.run(job, Supply(job, todo, engine.workers, retries))) as rows:
                for row in rows:
                    index.add(row)
                    tell(row)
        index.finish()
    if shard is not None and _merged(job, index.note, int(shard.partition("/")[2])):
        return dataclasses.replace(index.summary(start, True), index=_place(job.out))
    return index.summary(start, shard is None)


def merge(pairs: Sequence[Entry] | str | Path, job: Job) -> BatchSummary:
    """Write the index of what there is of a list, whoever did it; pairs that nobody has done are rows, too (`MISSING`).

    Shards do it themselves when the last one ends. `OutputError` while an unsharded run is at work there.
    """
    listed = _checked(pairs, job)
    start = time.monotonic()
    with _Index(job, listed, range(len(listed)), None) as index:
        index.take(tasks(job, listed), every=True)
        index.finish()
    return index.summary(start, True)


def save_list(pairs: Sequence[Entry], out: str | Path) -> str:
    """Write a list as pairs.csv (groups.csv) into a folder or store, for `read_pairs` (`read_groups`); returns its
    place."""
    name = f"{pairs[0].kind if pairs else 'pair'}s.csv"
    place = f"{str(out).rstrip('/')}/{name}"
    if not remote.is_address(place):
        claim(out, [name])
    _write(place, to_csv(pairs).encode())
    return place


def read_index(place: str | Path) -> list[dict[str, object]]:
    """The rows of an index, in the order of the list: of an output folder, or of an index itself. `InputError`."""
    text = str(place)
    require_pyarrow(text)
    if not text.endswith(".parquet"):
        text = f"{text.rstrip('/')}/{INDEX}"
    columns = read_columns(_read(text), text)
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


class _Index:
    """The index of a run, which is written again and again while it grows, and the lock on its folder."""

    def __init__(self, job: Job, entries: Sequence[Entry], rows: range, shard: str | None) -> None:
        self.job, self.entries, self.rows = job, entries, rows
        self.place = _place(job.out, shard)
        self.note = {"schema": SCHEMA, "made_with": job.made_with(), "list": _digest(entries)}
        self.done = self.failed = self.reused = 0
        self._table = IndexTable({"row": "int", **entries[0].columns, **STATE, **columns_of(job)})
        self._row_of = {entries[row].name: row for row in rows}
        self._begun = self._written = time.monotonic()
        self._held = ExitStack()

    def __enter__(self) -> "_Index":
        self._held.enter_context(_locked(self.place))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None and len(self._table):
                self._write(False)
        finally:
            self._held.__exit__(kind, error, trace)

    def take(self, listed: Sequence[Task], every: bool = False) -> list[Task]:
        """Adds the rows of pairs that are finished, or of `every` one as it is; returns those to be done."""
        results, todo = results_in(self.job.out, self.job.kind), list[Task]()
        for task in listed:
            row = results.row(task.entry.name, task.key)
            if row is not None and row.status == DONE:
                self.reused += 1
                self.add(row)
            elif every:
                self.add(row or Row(task.entry.name, MISSING))
            else:
                todo.append(task)
        return todo

    def add(self, row: Row) -> None:
        """Adds a row. The file is renewed after a tenth of the time that the run took so far."""
        number = self._row_of[row.name]
        state: dict[str, Value] = {"status": row.status, "reason": row.reason, "seconds": row.seconds}
        self._table.add({"row": number, **self.entries[number].told(), **state, **row.found})
        self.done += row.status == DONE
        self.failed += row.status == FAILED
        now = time.monotonic()
        if now - self._written > min(max((now - self._begun) / 10, FIRST), LAST):
            self._write(False)

    def finish(self) -> None:
        """Writes the whole index."""
        self._write(True)

    def summary(self, start: float, complete: bool) -> BatchSummary:
        """What became of its pairs since `start`."""
        seconds = time.monotonic() - start
        return BatchSummary(len(self.rows), self.done, self.reused, self.failed, seconds, self.place, complete)

    def _write(self, complete: bool) -> None:
        _write(self.place, self._table.to_bytes({**self.note, "complete": complete}))
        self._written = time.monotonic()


class _Teller:
    """Tells how far a run is, how fast, and how long it will take."""

    def __init__(self, count: int, what: str, progress: Progress, say: Callable[[str], None]) -> None:
        self.count, self.what, self.progress, self.say = count, what, progress, say
        self.done = self.failed = 0
        self.begun = self.said = time.monotonic()
        progress(what, 0.0)

    def __call__(self, row: Row) -> None:
        self.done += 1
        self.failed += row.status != DONE
        now = time.monotonic()
        self.progress(self.what, self.done / self.count)
        if row.status != DONE:
            self.say(f"{row.name}: {row.reason}")
        if now - self.said >= SAY and self.done < self.count:
            self.said = now
            rate = self.done / (now - self.begun)
            self.say(
                f"{self.done} of {self.count} {self.what}, {self.failed} failed, {self._rate(rate)}, "
                f"{_span((self.count - self.done) / rate)} left"
            )

    def _rate(self, per_second: float) -> str:
        return f"{per_second:.2g} {self.what}/s" if per_second >= 1 else f"{60 * per_second:.2g} {self.what}/min"


def _span(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min" if minutes else "1 min"


def _checked(pairs: Sequence[Entry] | str | Path, job: Job) -> Sequence[Entry]:
    """The pairs. Errors are those that would stop the run later."""
    require_pyarrow("the index of a batch")
    job.check()
    read: Callable[[str | Path], Sequence[Entry]] = read_groups if job.kind == "group" else read_pairs
    listed = read(pairs) if isinstance(pairs, str | Path) else pairs
    if not listed:
        raise InputError(f"the list holds no {job.kind}s: give one that does")
    if listed[0].kind != job.kind:
        raise ConfigError(f"--command {job.command} takes a list of {job.kind}s, not of {listed[0].kind}s")
    return listed


def _digest(entries: Sequence[Entry]) -> str:
    return hashlib.sha256(to_csv(entries).encode()).hexdigest()[:16]


def _place(out: str, shard: str | None = None) -> str:
    """Where the index of an output folder is, or that of a shard."""
    inside = [] if shard is None else [SHARDS, shard.replace("/", "-of-")]
    return "/".join([out.rstrip("/") or "/", *inside, INDEX])


def _merged(job: Job, note: Mapping[str, object], shards: int) -> bool:
    """Whether all shards are complete; then the index of all is written."""
    wanted, found = {**note, "complete": True}, list[tuple[str, bytes]]()
    for i in range(1, shards + 1):
        place = _place(job.out, f"{i}/{shards}")
        try:
            found.append((place, content := _read(place)))
            if read_note(content, place) != wanted:
                return False
        except InputError:  # not there yet
            return False
    place = _place(job.out)
    with _locked(place):
        _write(place, joined(found, wanted))
    return True


def _locked(place: str) -> AbstractContextManager[object]:
    """The folder of an index, for one run. Stores have no locks."""
    return nullcontext() if remote.is_address(place) else results_folder(Path(place).parent, [INDEX])


def _read(place: str) -> bytes:
    if remote.is_address(place):
        return remote.read(place)
    try:
        return reading.read_bytes(Path(place))
    except OSError as error:
        raise InputError(f"cannot read {place}: {error.strerror}; run the batch first") from error


def _write(place: str, content: bytes) -> None:
    if remote.is_address(place):
        remote.write(place, content)
    else:
        atomic_write(place, content)
