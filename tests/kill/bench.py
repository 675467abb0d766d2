"""Commands that are killed at random moments, started again, and compared with the same command left alone.

    python bench.py CHANGE SIGNAL FILE WORD...    zpm2 WORD..., which gets the signal just before it changes a file
                                                    for that time; how many changes there were goes to FILE

A trial depends on its case and its number, and where it is stopped by the clock, on the machine.
"""

import csv
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from commands import Case

HIDDEN = ".zpm2"
CHANGES = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate")
SIGNALS = (signal.SIGKILL,) * 4 + (signal.SIGTERM, signal.SIGINT)
SLOWEST = 600  # s, of one run
COSTS = ("timings", "seconds", "peak_mb", "mtime_ns")  # members and columns that say what a run took, and "s_" + stage


@dataclass(frozen=True)
class Ended:
    """A run: its exit code (minus the signal's number where one ended it), what it said, its seconds and changes."""

    code: int
    said: str
    seconds: float
    changes: int


@dataclass(frozen=True)
class Stop:
    """When a run is stopped, after `seconds` or else before its change number `change` of a file, and by what."""

    signal: signal.Signals
    seconds: float | None = None
    change: int = 0

    def __str__(self) -> str:
        when = f"before change {self.change}" if self.seconds is None else f"after {self.seconds:.2f} s"
        return f"{self.signal.name} {when}"


class Bench:
    """One command in a folder that holds its inputs (`in`). It always runs in `work` and writes into `work/out`, as
    results name the places of their inputs; what it left when nobody stopped it is moved to `alone`."""

    def __init__(self, case: "Case", folder: Path) -> None:
        self.case, self.folder = case, folder
        self.work, self.out, self.alone = folder / "work", folder / "work" / "out", folder / "alone"
        self.whole: Ended | None = None

    def reference(self) -> list[str]:
        """Runs it twice without a stop; in what the second result differs from the first one."""
        first = self.run()
        if first.code != self.case.code:
            raise AssertionError(f"{self.case.name} ends with {first.code}: {first.said}")
        self.out.rename(self.alone)
        self.whole = self.run()
        return [f"left alone: {odd}" for odd in differences(self.alone, self.out)]

    def trial(self, number: int) -> list[str]:
        """Stops it once or twice, lets it end, and says what is wrong then or was wrong half-way."""
        chance = random.Random(f"{self.case.name} {number}")
        stops = [self.moment(chance) for _ in range(chance.choice((1, 1, 1, 2)))]
        told, odd = ", then ".join(map(str, stops)), list[str]()
        shutil.rmtree(self.out, ignore_errors=True)
        for k, stop in enumerate(stops):
            ended = self.run(stop)
            odd += [f"half-way: {text}" for text in half(self.alone, self.out)]
            if stop.signal != signal.SIGKILL and ended.code == 130:
                if k == 0:  # a run that was killed before leaves what a later one removes
                    odd += [f"left behind: {path}" for path in self.out.rglob("*.part")]
            elif ended.code not in (self.case.code, -stop.signal):
                odd.append(f"ended with {ended.code}: {ended.said}")
        if (last := self.run()).code != self.case.code:
            odd.append(f"does not go on: {last.code}: {last.said}")
        return [f"{self.case.name} {number}: {told}: {text}" for text in odd + differences(self.alone, self.out)]

    def clear(self) -> None:
        """Makes room for the next command."""
        for folder in (self.work, self.alone):
            shutil.rmtree(folder, ignore_errors=True)

    def moment(self, chance: random.Random) -> Stop:
        """Half of the moments lie anywhere in the running time, half between two changes of files."""
        assert self.whole is not None
        number = signal.Signals(chance.choice(SIGNALS))
        if chance.random() < 0.5:
            return Stop(number, seconds=chance.random() * self.whole.seconds)
        return Stop(number, change=chance.randint(1, self.whole.changes))

    def run(self, stop: Stop | None = None) -> Ended:
        """The command once."""
        self.work.mkdir(exist_ok=True)
        counted = self.folder / "changes"
        counted.write_text("0")
        change, number = (stop.change, stop.signal) if stop else (0, signal.SIGKILL)
        words = [sys.executable, "-B", __file__, str(change), str(int(number)), str(counted), *self.case.words]
        environment = {**os.environ, "ZPM2_OFFLINE": "1", **self.case.environment}
        start = time.monotonic()
        with subprocess.Popen(
            words, cwd=self.work, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as child:
            try:
                said = child.communicate(timeout=SLOWEST if stop is None or stop.seconds is None else stop.seconds)[1]
            except subprocess.TimeoutExpired:
                child.send_signal(number)
                said = child.communicate(timeout=60)[1]
        return Ended(child.returncode, said[-600:], time.monotonic() - start, int(counted.read_text() or 0))


def differences(alone: Path, again: Path) -> list[str]:
    """In what a folder of results differs from that of a run that nobody stopped."""
    names, others = _files(alone), _files(again)
    odd = [f"{name} is missing" for name in sorted(names - others)]
    odd += [f"{name} is there" for name in sorted(others - names)]
    odd += [f"{name} differs" for name in sorted(names & others) if not same(alone / name, again / name)]
    return odd + [f"left behind: {path}" for path in _left(again)] + _not_on_record(again)


def half(alone: Path, again: Path) -> Iterator[str]:
    """What a run that was stopped left under the name of a result although it is none."""
    for name in sorted(_files(again)):
        if not (alone / name).is_file():
            if Path(name).parent.suffix != ".part":  # on its way into a folder that nobody claimed
                yield f"{name} is there"
        elif not same(alone / name, again / name):
            yield f"{name} differs"


def same(one: Path, other: Path) -> bool:
    """Whether two files are equal to the byte, or but for what the runs cost."""
    a, b = one.read_bytes(), other.read_bytes()
    return a == b or (one.suffix in _TIMELESS and _TIMELESS[one.suffix](a) == _TIMELESS[one.suffix](b))


def _is_cost(name: str) -> bool:
    return name in COSTS or name.startswith("s_")


def _json(content: bytes) -> Any:
    def plain(pairs: list[tuple[str, Any]]) -> list[tuple[str, Any]]:
        return [(name, value) for name, value in pairs if not _is_cost(name)]

    try:
        return json.loads(content, object_pairs_hook=plain)
    except ValueError:
        return content


def _rows(rows: list[list[str]]) -> list[list[str]]:
    """A table without the columns and the rows that are named for a cost."""
    kept = [k for k, name in enumerate(rows[0]) if not _is_cost(name)] if rows else []
    return [[row[k] for k in kept if k < len(row)] for row in rows if not row or not _is_cost(row[0])]


def _csv(content: bytes) -> Any:
    return _rows(list(csv.reader(io.StringIO(content.decode(), newline=""))))


def _markdown(content: bytes) -> Any:
    tables: list[Any] = [[]]
    for line in content.decode().splitlines():
        if line.startswith("| "):
            tables[-1].append([cell.strip() for cell in line.strip("|").split("|")])
        else:
            tables += [line, []]
    # a row of dashes says how the columns are aligned
    return [table if isinstance(table, str) else _rows(table[:1] + table[2:]) for table in tables]


def _parquet(content: bytes) -> Any:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(pyarrow.BufferReader(content))
    return {name: table[name].to_pylist() for name in table.column_names if not _is_cost(name)}


def _html(content: bytes) -> Any:
    return re.sub(rb'(?<=id="timings">).*?(?=</script>)', b"", content)


_TIMELESS = {".json": _json, ".html": _html, ".csv": _csv, ".md": _markdown, ".parquet": _parquet}


def _files(folder: Path) -> set[str]:
    """Results, seen from their folder, and the keys of what is kept; not what else is hidden there."""
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path.as_posix() for path in found if HIDDEN not in path.parts or "keys" in path.parts}


def _left(folder: Path) -> Iterator[Path]:
    """Temporary files, and what is kept for a run that goes on."""
    for path in folder.rglob("*"):
        if path.suffix == ".part" or (path.parent.name == HIDDEN and path.name == "tiles"):
            yield path.relative_to(folder)


def _not_on_record(folder: Path) -> list[str]:
    """Results that the next run would take for somebody else's. Links to photographs are the user's files, and stay."""
    from zpm2.errors import OutputError
    from zpm2.files.record import refuse_foreign

    odd = []
    for name in sorted(_files(folder)):
        try:
            if HIDDEN not in Path(name).parts and (folder / name).stat().st_nlink == 1:
                refuse_foreign(folder / name)
        except OutputError as error:
            odd.append(str(error))
    return odd


def _drive(stop: int, number: int, counted: str, words: list[str]) -> None:
    """The command in this process, which sends itself the signal. A file that is about to be opened is there by then,
    and empty."""
    count, here, own = 0, os.getcwd(), os.getpid()

    def changed(event: str, arguments: tuple[Any, ...]) -> bool:
        path = arguments[0]
        if event not in CHANGES or not isinstance(path, str | bytes | os.PathLike):
            return False
        if event == "open" and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return False
        return os.path.join(here, os.fsdecode(path)).startswith(here) and os.getpid() == own

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal count
        if not changed(event, arguments):
            return
        count += 1
        if count == stop:
            if event == "open" and number == signal.SIGKILL:
                os.close(os.open(arguments[0], arguments[2], 0o644))
            os.kill(own, number)

    sys.addaudithook(watch)
    sys.argv = ["zpm2", *words]
    from offered import offered

    from zpm2.cli.app import main

    try:
        with offered(words):
            main()
    finally:
        with open(counted, "w") as file:
            file.write(str(count))


if __name__ == "__main__":
    _drive(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4:])
