"""Every command stopped at many random moments and started again, with the counts as JSON at the end.

python tests/kill/long.py COUNT [NAME...] [--processes N]       of all, or of these: the names are in commands.py
"""

import argparse
import importlib.util
import json
import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bench import Bench
from commands import cases

PART = 5  # trials that a process makes with one set of inputs


def names() -> list[str]:
    """Of the commands whose packages are here."""
    with tempfile.TemporaryDirectory() as base, cases(Path(base), ready=False) as known:
        return [case.name for case in known if all(map(importlib.util.find_spec, case.needs))]


def trials(name: str, numbers: range) -> tuple[int, list[str], int]:
    """How many trials of these numbers end as they should, what is odd about the others, and the seconds."""
    with tempfile.TemporaryDirectory() as base, cases(Path(base)) as known:
        bench, start = Bench(next(case for case in known if case.name == name), Path(base)), time.monotonic()
        odd = bench.reference()
        for text in odd:
            print(text, file=sys.stderr, flush=True)
        equal = 0
        for number in numbers:
            found = bench.trial(number)
            equal += not found
            odd += found
            for text in found or [f"{name} {number}: equal"]:
                print(text, file=sys.stderr, flush=True)
        return equal, odd, round(time.monotonic() - start)


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("count", type=int)
    words.add_argument("names", nargs="*")
    words.add_argument("--processes", type=int, default=1)
    asked = words.parse_args()
    jobs = [
        (name, range(first, min(asked.count, first + PART)))
        for name in (asked.names or names())
        for first in range(0, asked.count, PART)
    ]
    counts: dict[str, dict[str, int]] = {}
    wrong = False
    with ProcessPoolExecutor(asked.processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        done = pool.map(trials, *zip(*jobs, strict=True))
        for (name, numbers), (equal, odd, seconds) in zip(jobs, done, strict=True):
            count = counts.setdefault(name, {"trials": 0, "equal": 0, "seconds": 0})
            for key, more in (("trials", len(numbers)), ("equal", equal), ("seconds", seconds)):
                count[key] += more
            print(json.dumps({name: count}), file=sys.stderr, flush=True)
            wrong = wrong or bool(odd)
    print(json.dumps(counts, indent=1))
    sys.exit(wrong)
