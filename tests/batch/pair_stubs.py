"""A command for pairs that needs no photographs: the name of the left file says what happens."""

import json
import os
import signal
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import ClassVar

from zpm2.batch import Job, Pair
from zpm2.batch.commands import Finished
from zpm2.errors import InputError, WeightsError, Zpm2Error
from zpm2.files.writing import atomic_write


class Lengths:
    """The lengths of two files. Left ones named bad*, odd*, dies* and killer* go wrong, odd and dies only once."""

    columns: ClassVar = {"left_bytes": "int", "right_bytes": "int", "by": "text"}

    def __init__(self, job: Job) -> None:
        self.job = job

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        for pair in pairs:
            name, once = Path(pair.left).name, Path(pair.left).with_suffix(".tried")
            first = not once.exists()
            if name.startswith(("odd", "dies")):
                once.touch()
            if name.startswith("killer") or (name.startswith("dies") and first):
                os.kill(os.getpid(), signal.SIGKILL)
            if name.startswith("odd") and first:
                raise RuntimeError("out of memory")
            if name.startswith("bad"):
                yield InputError(f"{pair.left} cannot be read")
                continue
            sizes = [os.path.getsize(path) for path in (pair.left, pair.right)]
            with open(Path(pair.left).parent / "log", "a") as log:  # who was done, and how often
                log.write(f"{pair.name}\n")
            yield Finished(
                lambda folder, sizes=sizes: (folder / "lengths.json").write_text(json.dumps(sizes)),
                {"left_bytes": sizes[0], "right_bytes": sizes[1], "by": self.job.k},
                0.5,
            )


LENGTHS = "pair_stubs:Lengths"


def listed(folder: Path, names: Iterable[str]) -> list[Pair]:
    """A pair of each left file, which is made, with one right one."""
    (folder / "right.png").write_bytes(b"12345")
    pairs = []
    for k, name in enumerate(names):
        (folder / f"{name}.png").write_bytes(b"x" * k)
        pairs.append(Pair(name, str(folder / f"{name}.png"), str(folder / "right.png")))
    return pairs


def counted(folder: Path) -> list[str]:
    """The pairs that were done, in the order of their names."""
    log = folder / "log"
    return sorted(log.read_text().split()) if log.exists() else []


def content(out: Path) -> dict[str, bytes]:
    """All files of the pairs."""
    files = (path for path in (out / "pairs").rglob("*") if path.is_file() and ".zpm2" not in path.parts)
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


class Recorded(Lengths):
    """Its files are on record, as those of real commands are."""

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        for made in super().results(pairs):
            if isinstance(made, Finished):
                text = json.dumps(dict(made.found))
                yield Finished(lambda folder, text=text: atomic_write(folder / "lengths.json", text), made.found, 0.5)
            else:
                yield made


class NoWeights(Lengths):
    """It can do no pair."""

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        raise WeightsError("no weights")
        yield
