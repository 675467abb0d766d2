"""Whether a pair gives the same result to the last bit: many calls in one process, and as many processes.

    python benchmarks/same_bytes.py left.png right.png --times 50 [--load 2] [--threads 1]

A digest goes over everything in a result but the times. Between the calls the heap is stirred, and each fresh process
gets an environment of another size, so that arrays lie elsewhere; `--load` processes compete for the CPU meanwhile.
Prints one JSON document with how often each digest came, and ends with 1 if there is more than one.
"""

import argparse
import hashlib
import os
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2 import config
from zpm2.api import Matcher, own_regions

BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: sum(k * k for k in range(10**6))"


def parts(value: Any) -> Iterator[bytes]:
    """Everything in a value, as bytes that tell any two values apart."""
    if is_dataclass(value):
        yield type(value).__name__.encode()
        for field in fields(value):
            if field.name != "timings":
                yield field.name.encode()
                yield from parts(getattr(value, field.name))
    elif isinstance(value, np.ndarray) and value.dtype != object:
        yield f"{value.dtype} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, dict):
        yield from parts(list(value.items()))
    elif isinstance(value, list | tuple | np.ndarray):
        yield str(len(value)).encode()
        for one in value:
            yield from parts(one)
    else:
        yield repr(value).encode()  # of a float, the shortest text that gives it back to the last bit


def digest(result: Any) -> str:
    whole = hashlib.sha256()
    for part in parts(result):
        whole.update(len(part).to_bytes(8, "little") + part)
    return whole.hexdigest()[:16]


def digests(words: argparse.Namespace, times: int) -> Iterator[str]:
    """Of calls of one matcher in this process."""
    chosen = config.assign(config.preset(words.preset), words.set)
    own = own_regions(None, *(words.regions or (None, None)), chosen)
    matcher, stir = Matcher(chosen, segmenter=own), []
    for _ in range(times):
        yield digest(matcher(words.left, words.right))
        stir.append(bytearray(random.randrange(1, 10**6)))


def fresh(arguments: list[str], environment: dict[str, str]) -> str:
    """Of one call in a process of its own."""
    padded = {**environment, "PADDING": "x" * random.randrange(4096)}
    command = [sys.executable, __file__, *arguments, "--one"]
    return subprocess.run(command, env=padded, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("left", type=Path)
    parser.add_argument("right", type=Path)
    parser.add_argument("--times", type=int, default=50, help="calls, and fresh processes")
    parser.add_argument("--load", type=int, default=0, help="processes that compete for the CPU")
    parser.add_argument("--threads", type=int, help="OMP_NUM_THREADS of the fresh processes [default: as it is]")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the configuration")
    parser.add_argument("--regions", nargs=2, type=Path, help="files of own regions, left and right")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    words = parser.parse_args(arguments)
    if words.one:
        print(next(digests(words, 1)))
        return 0
    environment = dict(os.environ) | ({} if words.threads is None else {"OMP_NUM_THREADS": str(words.threads)})
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(words.load)]
    found: dict[str, Counter[str]] = {"calls": Counter(), "processes": Counter()}
    try:
        for call in digests(words, words.times):
            found["calls"][call] += 1
            found["processes"][fresh(arguments, environment)] += 1
            print(*(dict(count) for count in found.values()), file=sys.stderr, flush=True)
    finally:
        for process in busy:
            process.kill()
    print(document.text("zpm2-bench-same-bytes/1", **found))
    return int(len(found["processes"] | found["calls"]) > 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
