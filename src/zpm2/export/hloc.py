"""Files of hloc (Sarlin et al., CVPR 2019, https://github.com/cvg/Hierarchical-Localization; extra `hloc`)."""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from zpm2.errors import InputError, MissingDependency
from zpm2.export.keypoints import Keypoints, PairPoints
from zpm2.files.record import move_into_place, temporary_folder
from zpm2.files.writing import atomic_write

if TYPE_CHECKING:
    import h5py

FEATURES, MATCHES, PAIRS = FILES = ("features.h5", "matches.h5", "pairs.txt")


def require_h5py() -> ModuleType:
    """The package, or `MissingDependency`."""
    try:
        import h5py
    except ImportError as error:
        raise MissingDependency('files of hloc need h5py: pip install "zpm2[hloc]"') from error
    return h5py


def write(keypoints: Keypoints, folder: Path) -> None:
    """Writes features.h5, matches.h5 and pairs.txt into an existing folder, as hloc's `triangulation` and
    `reconstruction` read them.

    Keypoints count from the centre of the first pixel, as all of hloc does: 0.5 px less than ours. They have no
    descriptors. `InputError` where hloc would give two pairs one name.
    """
    h5py = require_h5py()
    groups = _groups(keypoints.pairs)
    with temporary_folder(folder) as part:
        with h5py.File(part / FEATURES, "w", libver="latest") as file:
            for name, points in keypoints.points.items():
                _put(file.create_group(name), "keypoints", (points - 0.5).astype(np.float32))
        with h5py.File(part / MATCHES, "w", libver="latest") as file:
            for name, pair in groups.items():
                group = file.create_group(name)
                count = len(keypoints.points[pair.names[0]])
                best = np.lexsort((-pair.score, pair.rows[:, 0]))  # hloc has one match for each keypoint
                first, at = np.unique(pair.rows[best, 0], return_index=True)
                matches, scores = np.full(count, -1, np.int32), np.zeros(count, np.float16)
                matches[first] = pair.rows[best[at], 1]
                scores[first] = pair.score[best[at]]
                _put(group, "matches0", matches)
                _put(group, "matching_scores0", scores)
        for name in (FEATURES, MATCHES):
            move_into_place(part / name, folder / name)
    atomic_write(folder / PAIRS, "".join(f"{' '.join(pair.names)}\n" for pair in keypoints.pairs))


def _groups(pairs: Sequence[PairPoints]) -> dict[str, PairPoints]:
    """Each pair by the name that hloc gives it."""
    found: dict[str, PairPoints] = {}
    for pair in pairs:
        other = found.setdefault("/".join(name.replace("/", "-") for name in pair.names), pair)
        if other is not pair:
            one, two = next(both for both in zip(other.names, pair.names, strict=True) if both[0] != both[1])
            raise InputError(f"{one} and {two} have one name in hloc, which writes / as -: rename one of them")
    return found


def _put(group: "h5py.Group", name: str, values: np.ndarray) -> None:
    group.create_dataset(name, data=values, track_times=False)
