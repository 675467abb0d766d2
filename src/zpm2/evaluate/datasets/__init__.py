"""Data sets in their publishers' folder layouts, opened by name and read lazily (paper 4.1)."""

import inspect
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any

from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.datasets import dtu, eth3d, isprs, kitti, middlebury, pair_list, scannet, scannet1500, sceneflow
from zpm2.evaluate.pairs import Dataset, EvalPair

Lister = Callable[..., Iterator[EvalPair]]  # (root, split, *, options)

_FAMILIES: dict[str, tuple[Lister, Sequence[str] | None]] = {  # with the names of its splits, None: named by the data
    "sceneflow": (sceneflow.pairs, sceneflow.SPLITS),
    "kitti2012": (kitti.pairs_2012, kitti.SPLITS),
    "kitti2015": (kitti.pairs_2015, kitti.SPLITS),
    "scannet": (scannet.pairs, None),
    "scannet1500": (scannet1500.pairs, scannet1500.SPLITS),
    "dtu": (dtu.pairs, None),
    "isprs": (isprs.pairs, None),
    "middlebury": (middlebury.pairs, None),
    "eth3d": (eth3d.pairs, eth3d.SPLITS),
    "pairs": (pair_list.from_json, None),
    "csv": (pair_list.from_csv, None),
}
DATASETS = tuple(_FAMILIES)


def open_dataset(name: str, root: str | Path, split: str | None = None, **options: Any) -> Dataset:
    """The data set `name` (one of `DATASETS`) in the folder `root`; nothing but the folder is looked at yet.

    docs/datasets.md shows the files that each one looks for.

    split: a part of it, None for the usual or for all; options: `render` of sceneflow, `occluded` of kitti2012 and
    kitti2015, `gap` of scannet. `ConfigError` for a name, split or option that does not exist, `InputError` where
    `root` is no folder.
    """
    _known("data set", name, DATASETS)
    lister, splits = _FAMILIES[name]
    if split is not None and splits is not None:
        _known(f"split of {name}", split, splits)
    parameters = inspect.signature(lister).parameters.values()
    for option in options:
        _known(f"option of {name}", option, [p.name for p in parameters if p.kind is p.KEYWORD_ONLY])
    if not os.path.isdir(root):
        raise InputError(f"root of data set {name}: {root} is no folder: give the one that holds its files")
    return _Folder(name, partial(lister, Path(root), split, **options))


@dataclass
class _Folder:
    """A data set whose pairs a lister finds."""

    name: str
    listed: Callable[[], Iterator[EvalPair]]

    def pairs(self) -> Iterator[EvalPair]:
        """Its pairs, in a fixed order. `InputError` names the file that was looked for where something is missing, at
        the pair that needs it, and a name that comes twice."""
        seen: set[str] = set()
        for pair in self.listed():
            if pair.name in seen:
                raise InputError(f"data set {self.name} has two pairs named '{pair.name}': rename one, or give a split")
            seen.add(pair.name)
            yield pair


def _known(what: str, name: str, names: Sequence[str]) -> None:
    if name in names:
        return
    close = get_close_matches(name, names, n=1)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    raise ConfigError(f"unknown {what} '{name}'{hint}; there are: {', '.join(names) or 'none'}")


__all__ = ["DATASETS", "open_dataset"]
