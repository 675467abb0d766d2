"""The contract of a data set (`zpm2.evaluate.datasets`). A check takes its entry and its folder, if there is one."""

import inspect
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import get_args

from zpm2.contract.check import Broken, expect
from zpm2.errors import InputError
from zpm2.evaluate.datasets.registry import DatasetFormat
from zpm2.evaluate.pairs import DepthTruth, EvalPair, Truth

MOST = 50  # pairs that are looked at


@dataclass(frozen=True)
class Folder:
    """A data set, and the folder that holds it, for `WITH_FILES`."""

    entry: DatasetFormat
    root: Path | None = None


def takes_a_root_and_a_split(folder: Folder) -> None:
    """It is a function of a root and a split; all else it takes is an option, keyword-only, with a default."""
    parameters = list(inspect.signature(folder.entry.load).parameters.values())
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    expect(len(positional) == 2, f"it has {len(positional)} positional parameters: take (root, split, *, options)")
    options = [p for p in parameters if p.kind is p.KEYWORD_ONLY]
    expect(all(p.default is not p.empty for p in options), "an option has no default: give each one")


def says_what_it_looked_for(folder: Folder) -> None:
    """An empty folder raises `InputError` with the path that it looked at, when the first pair is asked for."""
    with tempfile.TemporaryDirectory() as empty:
        try:
            next(iter(folder.entry.load(Path(empty), None)))
        except InputError as error:
            expect(empty in str(error), f"an empty folder raises '{error}', which names no file: name the one it needs")
        except StopIteration:
            raise Broken("an empty folder gives no pairs and no error: raise InputError that names the file") from None
        except Exception as error:
            raise Broken(
                f"an empty folder raises {type(error).__name__}: raise zpm2.errors.InputError that names the file"
            ) from error
        else:
            raise Broken("an empty folder gives a pair: look whether its files are there")


def pairs_are_whole(folder: Folder) -> None:
    """Each pair has a name of its own that can be a path, two photographs that exist, and a truth of a known kind."""
    pairs = _pairs(folder)
    names = [pair.name for pair in pairs]
    expect(bool(pairs), "there are no pairs: raise InputError that says what is missing")
    expect(len(set(names)) == len(names), "two pairs have one name: add what tells them apart")
    for pair in pairs:
        what = f"pair '{pair.name}'"
        parts = pair.name.split("/")
        good = bool(re.fullmatch(r"[A-Za-z0-9._/-]+", pair.name)) and not {"", ".", ".."} & set(parts)
        expect(good, f"{what} has a name that is no path: use letters, digits, '.', '_', '-' and '/'")
        for file in (pair.left, pair.right):
            expect(isinstance(file, Path) and file.is_file(), f"{what}: {file} is no file: give a Path that exists")
        known = pair.truth is None or isinstance(pair.truth, get_args(Truth))
        expect(known, f"{what} has a truth of type {type(pair.truth).__name__}: use one of zpm2.evaluate.pairs")
        files = pair.truth.files if isinstance(pair.truth, DepthTruth) else [getattr(pair.truth, "file", None)]
        gone = [file for file in files if file is not None and not file.is_file()]
        expect(not gone, f"{what}: the truth {gone} is no file: give what exists, or no truth")


def same_list_twice(folder: Folder) -> None:
    """Listing twice gives the same pairs in the same order."""
    first, second = ([(pair.name, pair.left, pair.right) for pair in _pairs(folder)] for _ in range(2))
    expect(first == second, "its pairs come in another order the second time: sort what lists folders")


def _pairs(folder: Folder) -> list[EvalPair]:
    return [] if folder.root is None else list(islice(folder.entry.load(folder.root, None), MOST))


CHECKS: Mapping[str, Callable[[Folder], None]] = {
    "takes a root and a split": takes_a_root_and_a_split,
    "says what it looked for in an empty folder": says_what_it_looked_for,
}
WITH_FILES: Mapping[str, Callable[[Folder], None]] = {
    "gives whole pairs": pairs_are_whole,
    "gives the same list twice": same_list_twice,
}
