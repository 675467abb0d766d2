"""What estimates a relative pose from homologous rays: OpenCV, or PoseLib where it is installed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.errors import ConfigError, Failed, MissingDependency

Array = NDArray[np.float64]
ENOUGH = 8  # homologous points, below which there is no pose: five fit one exactly and prove nothing


@dataclass(frozen=True, eq=False)
class Motion:
    """The right camera seen from the left one: X_right = R X_left + s t for some s > 0."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,) of unit length
    inliers: NDArray[np.bool_]  # (n,) of the points that it was estimated from

    @property
    def essential(self) -> Array:
        """(3, 3) [t]x R: r_right^T E r_left = 0 for homologous rays."""
        return geometry.cross_matrix(self.translation) @ self.rotation


class PoseEstimator(Protocol):
    """A robust estimator of the pose of two calibrated views."""

    @property
    def name(self) -> str:
        """What it is called in `PoseConfig.estimator`."""
        ...

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> Motion | Failed:
        """The pose under which most of the homologous rays (n, 2) agree, or why there is none.

        `threshold` is the noise of an inlier in units of rays (px / focal length). The same input gives the same pose.
        """
        ...


class OpenCv:
    """E by the five-point algorithm in MAGSAC++ (Barath et al., CVPR 2020; OpenCV's USAC), R and t by cheirality."""

    name = "opencv"

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> Motion | Failed:
        if len(left) < ENOUGH:
            return _too_few(len(left))
        essential = geometry.essential_matrix(left, right, threshold, seed)
        if isinstance(essential, Failed):
            return essential
        matrix, mask = essential
        first, second, direction = cv2.decomposeEssentialMat(matrix)
        motions = [(turn, sign * direction.ravel()) for turn in (first, second) for sign in (1.0, -1.0)]
        # cv2.recoverPose would count points farther than 50 baselines as behind the cameras
        before = [geometry.in_front(turn, shift, left, right) & mask for turn, shift in motions]
        best = int(np.argmax([front.sum() for front in before]))
        return _proven(Motion(np.asarray(motions[best][0]), np.asarray(motions[best][1]), before[best]))


class PoseLib:
    """LO-RANSAC with bundle adjustment on the Sampson error (PoseLib, Larsson et al.)."""

    name = "poselib"

    def __init__(self) -> None:
        try:
            import poselib
        except ImportError as error:
            raise MissingDependency("the estimator poselib is not installed: pip install poselib") from error
        self.solve = poselib.estimate_relative_pose

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> Motion | Failed:
        if len(left) < ENOUGH:
            return _too_few(len(left))
        # PoseLib expects px: these are px of a camera in which the noise is one
        unit = {"model": "PINHOLE", "width": 0, "height": 0, "params": [1 / threshold, 1 / threshold, 0.0, 0.0]}
        ransac = {"max_epipolar_error": 1.0, "seed": seed, "max_iterations": 20000, "min_iterations": 1000}
        pose, info = self.solve(left / threshold, right / threshold, unit, unit, ransac, {"loss_scale": 1.0})
        length = float(np.linalg.norm(pose.t))
        if not np.isfinite([*pose.R.ravel(), *pose.t]).all() or not length:
            return Failed("no relative pose fits the homologous points")
        return _proven(Motion(np.asarray(pose.R), np.asarray(pose.t) / length, np.array(info["inliers"], bool)))


ESTIMATORS: Mapping[str, Callable[[], PoseEstimator]] = {"opencv": OpenCv, "poselib": PoseLib}


def open_estimator(name: str) -> PoseEstimator:
    """The estimator of that name; `MissingDependency` where its package is not installed. "auto" is PoseLib where it is
    installed, else OpenCV."""
    if name == "auto":
        name = "poselib" if find_spec("poselib") else "opencv"
    if name not in ESTIMATORS:
        raise ConfigError(f"unknown estimator '{name}'; estimators are: {', '.join(ESTIMATORS)}")
    return ESTIMATORS[name]()


def _too_few(count: int) -> Failed:
    return Failed(f"a relative pose is trusted from {ENOUGH} homologous points on, there are {count}")


def _proven(motion: Motion) -> Motion | Failed:
    agreeing, total = int(motion.inliers.sum()), len(motion.inliers)
    if agreeing < ENOUGH:
        return Failed(f"only {agreeing} of {total} homologous points agree on a relative pose")
    return motion
