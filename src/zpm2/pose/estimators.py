"""Robust estimators of a relative pose from homologous rays: OpenCV, and PoseLib where it is installed."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import PoseConfig
from zpm2.cores import in_chunks
from zpm2.errors import ConfigError, Failed, MissingDependency
from zpm2.pose.points import RayPairs

Array = NDArray[np.float64]
DEFAULTS = PoseConfig()


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The right camera seen from the left one: X_right = R X_left + s t for some s > 0."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,) of unit length
    inliers: NDArray[np.bool_]  # (n,) of the points that it was estimated from
    starts: int = 1  # of which it is the most likely one

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

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> PoseEstimate | Failed:
        """The pose on which most of the homologous rays (n, 2) agree, or why there is none.

        `threshold` is the noise of an inlier in units of rays (px / focal length). The same input gives the same pose.
        """
        ...


class OpenCv:
    """E by the five-point algorithm in MAGSAC++ (Barath et al., CVPR 2020; OpenCV's USAC), R and t by cheirality."""

    name = "opencv"

    def __init__(self, config: PoseConfig = DEFAULTS) -> None:
        self.config = config

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> PoseEstimate | Failed:
        if len(left) < self.config.min_points:
            return _too_few(len(left), self.config)
        essential = geometry.essential_matrix(left, right, threshold, seed, self.config.magsac)
        if isinstance(essential, Failed):
            return essential
        matrix, mask = essential
        first, second, direction = cv2.decomposeEssentialMat(matrix)
        motions = [
            (np.asarray(rotation), np.asarray(sign * direction.ravel()))
            for rotation in (first, second)
            for sign in (1.0, -1.0)
        ]
        # cv2.recoverPose would count points farther than 50 baselines as behind the cameras
        in_front = [geometry.in_front(*motion, left, right) & mask for motion in motions]
        best = int(np.argmax([front.sum() for front in in_front]))
        return _with_enough_inliers(PoseEstimate(*motions[best], in_front[best]), self.config)


class PoseLib:
    """LO-RANSAC with bundle adjustment on the Sampson error (PoseLib, Larsson et al.)."""

    name = "poselib"

    def __init__(self, config: PoseConfig = DEFAULTS) -> None:
        self.config = config
        try:
            import poselib
        except ImportError as error:
            raise MissingDependency("the estimator poselib is not installed: pip install poselib") from error
        self.solve = poselib.estimate_relative_pose

    def estimate(self, left: Array, right: Array, threshold: float, seed: int) -> PoseEstimate | Failed:
        if len(left) < self.config.min_points:
            return _too_few(len(left), self.config)
        # PoseLib expects px: it gets those of a camera in which the noise is one px
        unit = {"model": "PINHOLE", "width": 0, "height": 0, "params": [1 / threshold, 1 / threshold, 0.0, 0.0]}
        ransac = {
            "max_epipolar_error": 1.0,
            "seed": seed,
            "max_iterations": self.config.poselib_max_iterations,
            "min_iterations": self.config.poselib_min_iterations,
        }
        pose, info = self.solve(left / threshold, right / threshold, unit, unit, ransac, {"loss_scale": 1.0})
        length = float(np.linalg.norm(pose.t))
        if not np.isfinite([*pose.R.ravel(), *pose.t]).all() or not length:
            return Failed("no relative pose fits the homologous points")
        inliers = np.array(info["inliers"], bool)
        return _with_enough_inliers(PoseEstimate(np.asarray(pose.R), np.asarray(pose.t) / length, inliers), self.config)


ESTIMATORS: Mapping[str, Callable[[PoseConfig], PoseEstimator]] = {"opencv": OpenCv, "poselib": PoseLib}


def open_estimator(name: str, config: PoseConfig = DEFAULTS) -> PoseEstimator:
    """The estimator of that name; `MissingDependency` where its package is not installed. "auto" is PoseLib where it is
    installed, else OpenCV."""
    if name == "auto":
        name = "poselib" if find_spec("poselib") else "opencv"
    if name not in ESTIMATORS:
        raise ConfigError(f"unknown estimator '{name}'; estimators are: {', '.join(ESTIMATORS)}")
    return ESTIMATORS[name](config)


def most_likely(
    estimator: PoseEstimator,
    further: PoseEstimator,
    rays: RayPairs,
    whole: NDArray[np.bool_],
    seed: int,
    config: PoseConfig,
) -> PoseEstimate | Failed:
    """What `estimator` finds for n rays. Where fewer than `config.sure_inliers` of those of the `whole` images (n,)
    agree, `further` starts on these with other seeds, `config.starts` starts in all, and the pose under which they are
    most likely counts.

    Few inliers let random samples end at different poses, and the count of inliers says little about which of them is
    right. So all rays of the whole images are asked, by a Cauchy distribution of their Sampson distances (scale
    `config.tail`): it has room for wrong points, and for right ones that are less exact. Points of crops have no say in
    this, as they were searched for where the matches put them.
    """
    rows = np.flatnonzero(whole)
    asked = rays[rows]

    def start(numbers: slice) -> PoseEstimate | Failed:
        found = further.estimate(asked.left, asked.right, rays.noise, seed * config.starts + 1 + numbers.start)
        return among(found, rows, len(rays))

    def unlikeliness(found: PoseEstimate | Failed) -> float:
        if isinstance(found, Failed):
            return np.inf
        return float(np.log1p((asked.distance(found.essential) / (config.tail * rays.noise)) ** 2).sum())

    first = estimator.estimate(rays.left, rays.right, rays.noise, seed * config.starts)
    if not isinstance(first, Failed) and first.inliers[rows].sum() >= config.sure_inliers * len(rows):
        return first
    best = min([first, *in_chunks(start, config.starts - 1, 1)], key=unlikeliness)
    return best if isinstance(best, Failed) else dataclasses.replace(best, starts=config.starts)


def among(found: PoseEstimate | Failed, rows: NDArray[np.intp], count: int) -> PoseEstimate | Failed:
    """The same pose, whose points were the `rows` of `count` points."""
    if isinstance(found, Failed):
        return found
    inliers = np.zeros(count, bool)
    inliers[rows] = found.inliers
    return dataclasses.replace(found, inliers=inliers)


def _too_few(count: int, config: PoseConfig) -> Failed:
    return Failed(f"a relative pose is trusted from {config.min_points} homologous points on, there are {count}")


def _with_enough_inliers(estimate: PoseEstimate, config: PoseConfig) -> PoseEstimate | Failed:
    agreeing, total = int(estimate.inliers.sum()), len(estimate.inliers)
    if agreeing < config.min_points:
        return Failed(f"only {agreeing} of {total} homologous points agree on a relative pose")
    return estimate
