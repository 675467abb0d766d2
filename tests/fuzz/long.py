"""Many mutants over all readers, with their counts as JSON at the end.

python tests/fuzz/long.py COUNT [FIRST] [--reader WORDS] [--processes N]

What goes wrong is told at once on stderr, as is the number of cases that are done: a run that was stopped goes on with
that number added to FIRST.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from time import monotonic
from typing import Any

from harness import run, summary

PART = 500  # cases that a process takes at a time; what one has done is lost where the run is stopped


def told(count: int, first: int, only: str, processes: int) -> Iterator[dict[str, Any]]:
    """The cases of several processes as they come."""
    start = monotonic()
    parts = [(k, min(PART, first + count - k)) for k in range(first, first + count, PART)]
    with ThreadPoolExecutor(processes) as pool:
        results = pool.map(lambda part: list(run(*part, only)), parts)
        for (begin, size), cases in zip(parts, results, strict=True):
            yield from cases
            done = begin + size - first
            print(f"{done} of {count} cases, {monotonic() - start:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("count", type=int)
    words.add_argument("first", type=int, nargs="?", default=0)
    words.add_argument("--reader", default="", help="part of a reader's name: the others' cases are left out")
    words.add_argument("--processes", type=int, default=1)
    asked = words.parse_args()
    cases = told(asked.count, asked.first, asked.reader, asked.processes)
    found = summary(cases, lambda line: print(line, file=sys.stderr, flush=True))
    print(json.dumps(found, indent=1))
    sys.exit("wrong" in found)
