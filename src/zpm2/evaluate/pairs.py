"""What an evaluation reads: pairs of photographs and what is known about them. Files are read when they are needed.

Intrinsics are ours: pixel centres at +0.5. Loaders convert what their data set writes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DisparityTruth:
    """A rectified pair: left (x, y) is right (x - d, y). d is negative where the right photograph is the first one."""

    file: Path  # .pfm, .png or .npy; d = sign * value / scale; 0, inf and NaN are unknown
    scale: float = 1.0
    sign: int = 1  # -1: the file stores -d; 0: it stores either, and d is positive (SceneFlow)


@dataclass(frozen=True, eq=False)
class PoseTruth:
    """Two calibrated views: X_right = R X_left + t."""

    intrinsics: tuple[Array, Array]  # 3 x 3 each, left and right, pixel centres at +0.5
    pose: Array  # 4 x 4, left camera to right camera


@dataclass(frozen=True, eq=False)
class DepthTruth(PoseTruth):
    """Two calibrated views and the depth of the left one."""

    files: tuple[Path, Path | None]  # depth of the left image, and of the right one for the occlusion test
    scale: float = 1000.0  # metres = value / scale; 0 is unknown


@dataclass(frozen=True, eq=False)
class HomographyTruth:
    """A plane, or a camera that only turned: p_right ~ H p_left, image px."""

    matrix: Array  # 3 x 3


Truth = DisparityTruth | DepthTruth | PoseTruth | HomographyTruth


@dataclass(frozen=True, eq=False)
class EvalPair:
    """One pair of a data set."""

    name: str  # unique within the data set, usable as a path: letters, digits, '.', '_', '-', '/'
    left: Path
    right: Path
    truth: Truth | None = None  # None: nothing is known, look at the overlay


class Dataset(Protocol):
    """A data set in its publisher's folder layout."""

    name: str

    def pairs(self) -> Iterator[EvalPair]:
        """Its pairs, in a fixed order. `InputError` with the name of a file that is missing."""
        ...
