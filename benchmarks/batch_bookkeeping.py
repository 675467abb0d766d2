"""What the bookkeeping of `zpm2 batch` costs: list, keys, scheduler, folders and index, with nothing matched.

    python benchmarks/batch_bookkeeping.py --pairs 12500 25000 50000 100000 --workers 2 > batch_bookkeeping.json

Photographs are small files, each in 100 pairs or so; the command `Nothing` writes a file of 16 bytes for each pair.
For each number of pairs: ms for each pair of a first run, of a second one that finds everything finished, and of the
merge of the index, as wall clock, as CPU time of this process, and, of the first run, of its workers; the size of the
index; and the most memory of this process.
"""

import argparse
import resource
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import document

from zpm2 import batch
from zpm2.batch.commands import Finished
from zpm2.config import assign, preset

SCHEMA = "zpm2-bench-batch/1"


class Nothing:
    """A command that does nothing with a pair."""

    columns: ClassVar = {"matches": "int"}

    def __init__(self, job: batch.Job) -> None:
        pass

    def results(self, pairs: Iterable[batch.Pair]) -> Iterator[Finished]:
        for _ in pairs:
            yield Finished(
                lambda folder: (folder / "nothing.json").write_bytes(b'{"nothing": 1} '), {"matches": 0}, 0.0
            )


def listed(count: int, folder: Path) -> list[batch.Pair]:
    """So many pairs of neighbours, of a hundredth as many photographs and 200 more."""
    photographs = [str(folder / f"{k:07d}.jpg") for k in range(count // 100 + 200)]
    for path in photographs:
        Path(path).write_bytes(path.encode())
    rows = [(k // 100, k // 100 + 1 + k % 100) for k in range(count)]
    return [batch.Pair(f"{a:07d}_{b:07d}", photographs[a], photographs[b]) for a, b in rows]


def measured(count: int, workers: int) -> dict[str, Any]:
    """One line."""
    with TemporaryDirectory() as base:
        pairs = listed(count, Path(base))
        job = batch.Job(f"{base}/out", "batch_bookkeeping:Nothing", assign(preset("default"), ["device=cpu"]))
        row: dict[str, Any] = {"pairs": count, "workers": workers}
        for name in ("first", "second", "merge"):
            wall, cpu, hands = time.perf_counter(), time.process_time(), _of_children()
            if name == "merge":
                found = batch.merge(pairs, job)
            else:
                found = batch.run(pairs, job, engine=batch.Processes(workers))
            assert (found.done, found.failed) == (count, 0)
            row[f"{name}_ms"] = round(1000 * (time.perf_counter() - wall) / count, 3)
            row[f"{name}_cpu_ms"] = round(1000 * (time.process_time() - cpu) / count, 3)
            if name == "first":
                row["workers_cpu_ms"] = round(1000 * (_of_children() - hands) / count, 3)
        row["index_bytes"] = round(Path(found.index).stat().st_size / count, 1)
        row["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        return row


def _of_children() -> float:
    """CPU seconds of processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--pairs", type=int, nargs="+", default=[12500, 25000, 50000, 100000])
    words.add_argument("--workers", type=int, default=2)
    asked = words.parse_args()
    rows = []
    for count in asked.pairs:
        rows.append(measured(count, asked.workers))
        print(rows[-1], file=sys.stderr, flush=True)
    print(document.text(SCHEMA, rows=rows))
