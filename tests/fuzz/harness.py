"""Mutants to readers, in a process of their own: what comes out, how long it takes, how much memory.

    python harness.py FIRST COUNT     cases FIRST to FIRST + COUNT - 1, a line of JSON for each that went wrong

A case depends on its number alone: it is repeated by running it again.
"""

import faulthandler
import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any

from mutate import mutant
from readers import readers
from samples import Reader

SECONDS = 10  # of one case, at work
WAITING = 30  # s, at work or not
MEMORY = 10**9  # bytes beside those of the libraries
ENDED = "ended"  # the process: killed, crashed, or waiting in a library


class Hang(BaseException):
    """A case took too long."""


def case(reader: Reader, number: int, folder: Path) -> dict[str, bytes]:
    """The files of a case, in an empty folder."""
    chance = random.Random(f"{reader.name} {number}")
    sample = dict(chance.choice(reader.samples))
    names = [name for name in sample if name not in reader.still]
    chosen = names[0] if chance.random() < 0.5 else chance.choice(names)
    sample[chosen] = mutant(sample[chosen], chosen, chance)
    for name, content in sample.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return sample


def attempt(reader: Reader, folder: Path) -> tuple[str, str]:
    """What reading a folder ends in, "read", "refused", or the name of what should not have come out, and its words."""
    from zpm2.errors import Zpm2Error

    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        reader.read(folder)
    except Zpm2Error as error:
        return "refused" if str(error) and "\n" not in str(error) else f"no line in {_where(error)}", str(error)
    except Hang as error:
        return f"hang in {_where(error)}", ""
    except BaseException as error:
        return f"{type(error).__name__} in {_where(error)}", str(error)[:200]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return "read", ""


def run(first: int, count: int, only: str = "") -> Iterator[dict[str, Any]]:
    """Cases one after the other, each with its reader and what came of it, in processes with a limit of memory."""
    end = first + count
    while first < end:
        command = [sys.executable, __file__, str(first), str(end - first), only]
        with (
            tempfile.TemporaryFile("w+") as said,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True) as worker,
        ):
            at: dict[str, Any] = {}
            for line in worker.stdout or ():
                at = json.loads(line)
                if "kind" in at:
                    yield at
            worker.wait()
            said.seek(0)
            last = said.read()[-2000:]
        if worker.returncode == 0:
            return
        if not at or "kind" in at:
            raise RuntimeError(f"the worker ended between two cases, with {worker.returncode}: {last}")
        yield {**at, "kind": f"{ENDED} with {worker.returncode}", "why": last}
        first = at["case"] + 1


def summary(cases: Iterator[dict[str, Any]], tell: Any = None) -> dict[str, Any]:
    """Counts by outcome and by reader, the most seconds and MB that a case took, and the cases that went wrong, once
    for each kind with the numbers of the first few."""
    counts, wrong, by_reader = Counter[str](), dict[str, list[int]](), Counter[str]()
    worst = {"seconds": {"seconds": 0.0}, "mb": {"mb": 0}}
    for found in cases:
        kind = found["kind"]
        by_reader[found["reader"]] += 1
        for name in worst:
            if found.get(name, 0) > worst[name][name]:
                worst[name] = {name: found[name], "reader": found["reader"], "case": found["case"]}
        good = kind in ("read", "refused")
        counts[kind if good else "wrong"] += 1
        if not good:
            wrong.setdefault(f"{found['reader']}: {kind}", []).append(found["case"])
            if tell is not None and len(wrong[f"{found['reader']}: {kind}"]) == 1:
                tell(json.dumps(found))
    named = {kind: {"count": len(numbers), "cases": numbers[:3]} for kind, numbers in wrong.items()}
    sums = {"readers": dict(sorted(by_reader.items())), "worst": list(worst.values())}
    return {"mutants": sum(counts.values()), **counts, **sums, "kinds": named}


def _where(error: BaseException | None) -> str:
    """The last place in the package itself, and the last of all."""
    frames = traceback.extract_tb(error.__traceback__) if error is not None else []
    ours = [frame for frame in frames if "/zpm2/" in frame.filename]
    return " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in [*frames[-1:], *ours[-1:]])


def _memory(name: str) -> int:
    """KB, of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


def _worker(first: int, count: int, only: str) -> None:
    def late(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, late)
    known = readers()
    with tempfile.TemporaryDirectory() as base:
        for reader in known:  # valid samples load every library before there is a limit
            for k, sample in enumerate(reader.samples):
                folder = Path(base, "valid", reader.name, str(k))
                for name, content in sample.items():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (folder / name).write_bytes(content)
                if (outcome := attempt(reader, folder))[0] != "read":
                    raise AssertionError(f"{reader.name} does not read its valid sample {k}: {outcome}")
        warnings.filterwarnings("error", category=RuntimeWarning, module="zpm2")  # as in the tests of the package
        for number in range(first, first + count):
            reader = known[number % len(known)]
            if only not in reader.name:
                continue
            folder = Path(base, str(number))
            folder.mkdir()
            case(reader, number, folder)
            at = {"case": number, "reader": reader.name}
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
            print(json.dumps(at), flush=True)  # what a worker that is killed was at
            faulthandler.dump_traceback_later(WAITING, exit=True)  # in a library, where no signal is heard
            Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
            before, start = _memory("VmRSS"), monotonic()
            kind, why = attempt(reader, folder)
            faulthandler.cancel_dump_traceback_later()
            cost = {"seconds": round(monotonic() - start, 2), "mb": max(_memory("VmHWM") - before, 0) // 1024}
            print(json.dumps({**at, "kind": kind, "why": why, **cost}), flush=True)
            shutil.rmtree(folder)


if __name__ == "__main__":
    _worker(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")
