"""Every command stopped at many random moments and started again, with the counts as JSON at the end.

python tests/kill/long.py COUNT [NAME...]       of all, or of these: the names are in commands.py
"""

import importlib.util
import json
import sys
import tempfile
import time
from pathlib import Path

from bench import Bench
from commands import cases

if __name__ == "__main__":
    count, only = int(sys.argv[1]), sys.argv[2:]
    counts, wrong = {}, False
    with tempfile.TemporaryDirectory() as base, cases(Path(base)) as known:
        for case in known:
            missing = [name for name in case.needs if importlib.util.find_spec(name) is None]
            if (only and case.name not in only) or missing:
                continue
            bench, start = Bench(case, Path(base)), time.monotonic()
            odd = bench.reference()
            for text in odd:
                print(text, file=sys.stderr, flush=True)
            equal = 0
            for number in range(count):
                found = bench.trial(number)
                equal += not found
                odd += found
                for text in found or [f"{case.name} {number}: equal"]:
                    print(text, file=sys.stderr, flush=True)
            counts[case.name] = {"trials": count, "equal": equal, "seconds": round(time.monotonic() - start)}
            print(json.dumps({case.name: counts[case.name]}), file=sys.stderr, flush=True)
            wrong = wrong or bool(odd)
            bench.clear()
    print(json.dumps(counts, indent=1))
    sys.exit(wrong)
