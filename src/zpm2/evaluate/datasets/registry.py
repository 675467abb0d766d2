"""Data sets by name (`zpm2.plugins`): the files of this folder, and those of other packages.

A loader registers itself where it is defined:

    @dataset("mine", truth="pose", splits=("train", "test"))
    def pairs(root: Path, split: str | None) -> Iterator[EvalPair]: ...
"""

import inspect
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from zpm2.errors import ConfigError, InputError, did_you_mean
from zpm2.evaluate.pairs import Dataset, EvalPair
from zpm2.plugins import Registry, module_of

Loader = Callable[..., Iterator[EvalPair]]  # (root, split, *, options)


@dataclass(frozen=True)
class DatasetFormat:
    """A registered data set."""

    name: str
    load: Loader  # its keyword-only parameters are the options of the data set
    truth: str  # what is known about its pairs, for the documentation
    splits: tuple[str, ...] | None  # their names; None where they are named by the data


def _adopted(name: str, value: Any) -> DatasetFormat:
    if not callable(value):
        raise ConfigError(f"data set '{name}' is a {type(value).__name__}: give a function of a root and a split")
    return DatasetFormat(name, value, "unknown", None)


DATASETS: Registry[DatasetFormat] = Registry(
    "data set", "data sets", "zpm2.datasets", "zpm2.evaluate.datasets", _adopted
)


def dataset(name: str, *, truth: str, splits: tuple[str, ...] | None = None) -> Callable[[Loader], Loader]:
    """Register the loader of the data set `name`, see `DatasetFormat`. `ValueError` for a taken name."""

    def register(load: Loader) -> Loader:
        DATASETS.register(name, DatasetFormat(name, load, truth, splits), load, module_of(load))
        return load

    return register


def open_dataset(name: str, root: str | Path, split: str | None = None, **options: Any) -> Dataset:
    """The data set `name` (one of `DATASETS`, or package.module:function) in the folder `root`. No file is read yet.

    docs/datasets.md shows the files that each one needs.

    split: a part of it, None for the usual one or for all; options: those of its loader, as `render` of sceneflow.
    `ConfigError` for a name, split or option that does not exist, `InputError` where `root` is no folder.
    """
    chosen = DATASETS.get(name)
    if split is not None and chosen.splits is not None:
        _known(f"split of {name}", split, chosen.splits)
    parameters = inspect.signature(chosen.load).parameters.values()
    for option in options:
        _known(f"option of {name}", option, [p.name for p in parameters if p.kind is p.KEYWORD_ONLY])
    if not os.path.isdir(root):
        raise InputError(f"root of data set {name}: {root} is no folder: give the one that holds its files")
    return _Folder(name, partial(chosen.load, Path(root), split, **options))


@dataclass
class _Folder:
    """A data set whose pairs a loader lists."""

    name: str
    load: Callable[[], Iterator[EvalPair]]

    def pairs(self) -> Iterator[EvalPair]:
        """Its pairs, in a fixed order. `InputError` at a pair that lacks a file, with the file's name, and for a name
        that comes twice."""
        seen: set[str] = set()
        for pair in self.load():
            if pair.name in seen:
                raise InputError(f"data set {self.name} has two pairs named '{pair.name}': rename one, or give a split")
            seen.add(pair.name)
            yield pair


def _known(what: str, name: str, names: Sequence[str]) -> None:
    if name in names:
        return
    raise ConfigError(f"unknown {what} '{name}'{did_you_mean(name, names)}; there are: {', '.join(names) or 'none'}")
