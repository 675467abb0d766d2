"""A rectified pair of cameras: equal rows, one focal length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Camera, PosedCamera

Array = NDArray[np.float64]
MAX_SHIFT = 0.5  # px by which the rows of a rectified pair may differ, and its columns beside disparity


@dataclass(frozen=True, eq=False)
class Rig:
    """A rectified pair: equal rows, X_right = X_left - (baseline, 0, 0)."""

    left: Camera
    right: Camera
    baseline: float  # its unit is that of depths and of the cloud

    @property
    def offset(self) -> float:
        """px, cx of the right camera less that of the left one: disparity of a point at infinity, negative (doffs)."""
        return float(self.right.matrix[0, 2] - self.left.matrix[0, 2])

    @property
    def views(self) -> tuple[PosedCamera, PosedCamera]:
        """Both cameras in the frame of the left one."""
        shift = np.array([-self.baseline, 0.0, 0.0])
        return PosedCamera(self.left, np.eye(3), np.zeros(3)), PosedCamera(self.right, np.eye(3), shift)

    def depth(self, disparity: Array) -> Array:
        """Z = f B / (d + doffs); NaN where that is behind the cameras."""
        with np.errstate(divide="ignore", invalid="ignore"):
            z = self.left.matrix[0, 0] * self.baseline / (disparity + self.offset)
            return np.where(z > 0, z, np.nan)


def rig_of(left: Camera, right: Camera, baseline: float) -> Rig:
    """A rig of two cameras; `InputError` where they are not those of a rectified pair."""
    if left.size != right.size:
        raise InputError(
            f"images of a rectified pair have one size, these have {left.size} and {right.size} px: rectify it"
        )
    if not 0 < baseline < float("inf"):
        raise InputError(f"the baseline of a rectified pair is a length above 0, got {baseline:g}: correct it")
    a, b = left.matrix, right.matrix
    corners = np.array([[0, 0], left.size]) - a[:2, 2]
    shifts = corners * (np.diag(b)[:2] / np.diag(a)[:2] - 1) + [0, b[1, 2] - a[1, 2]]
    columns, rows = np.abs(shifts).max(0)
    if max(columns, rows) > MAX_SHIFT:
        raise InputError(
            f"a rectified pair has one focal length and one cy: with these cameras its rows differ by up to {rows:.1f} "
            f"px, its columns by {columns:.1f} px beside disparity; rectify it first (zpm2 pose --rectify)"
        )
    if left.distortion.any() or right.distortion.any():
        raise InputError("a rectified pair has no distortion left: rectify it first (zpm2 pose --rectify)")
    return Rig(left, right, baseline)
