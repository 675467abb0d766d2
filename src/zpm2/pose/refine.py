"""The pose that fits the inliers best, and its covariance."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.pose.estimators import PoseEstimate
from zpm2.pose.points import RayPairs

Array = NDArray[np.float64]
STEP_DONE = 1e-9  # rad: a smaller step ends the refinement
UNDETERMINED = 1e-10  # share of the largest eigenvalue, down to which an eigenvector is left open by the points
TAKES_PART = 0.01  # of a parameter in such a vector of unit length, from which on it is open, too


@dataclass(frozen=True, eq=False)
class RefinedPose:
    """A pose with its covariance: three angles of rotation about the right camera's axes, two of the direction of t."""

    estimate: PoseEstimate
    covariance: Array  # (5, 5) rad^2; infinite in rows and columns of what the points leave open

    @property
    def rotation_sigma(self) -> float:
        """Degrees, one standard deviation of the angle of rotation, all three axes together."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[:3, :3]))))

    @property
    def translation_sigma(self) -> float:
        """Degrees, one standard deviation of the direction of translation."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[3:, 3:]))))


def refine(estimate: PoseEstimate, rays: RayPairs, group: NDArray[np.intp], steps: int) -> RefinedPose:
    """The pose with the least sum of robustly weighted squared Sampson distances of the inliers, near `estimate`.

    rays: those that the pose was estimated from. The weights are those of Geman and McClure, scaled by the noise. They
    give far points almost no weight, so it matters little which far points are among the inliers. The inliers should
    still reach well beyond the noise: an estimate from only the points that fit looks more exact than it is. At most
    `steps` Newton steps.

    The covariance is estimated by leaving out one `group` (n,) after the other, with one Newton step each (the
    jackknife, CR3 of Bell and McCaffrey, Survey Methodology 2002). The points of a group share their errors, so groups
    are counted, not points.
    """
    rows = np.flatnonzero(estimate.inliers)
    rays, group = rays[rows], group[rows]
    rotation, translation = estimate.rotation, estimate.translation
    for _ in range(steps):
        residual = _residual(rotation, translation, rays)
        error, jacobian = residual(np.zeros(5)), _jacobian(residual)
        weight = 1 / (1 + error**2) ** 2
        normal = jacobian.T @ (weight[:, None] * jacobian)
        step = np.asarray(np.linalg.lstsq(normal, -jacobian.T @ (weight * error), rcond=1e-12)[0], np.float64)
        rotation, translation = _moved(rotation, translation, step)
        if np.linalg.norm(step) < STEP_DONE:
            break
    residual = _residual(rotation, translation, rays)
    covariance = _covariance(residual(np.zeros(5)), _jacobian(residual), group)
    return RefinedPose(dataclasses.replace(estimate, rotation=rotation, translation=translation), covariance)


def blocks(points: Array, along: int) -> NDArray[np.intp]:
    """(n,) which of `along` x `along` blocks of like many points each point is in: columns, each cut into rows.

    Errors of a camera, a lens or a matcher are alike in large parts of an image. The blocks are as large as they can
    be while there are enough of them to compare.
    """
    n, column = len(points), np.empty(len(points), np.intp)
    column[np.argsort(points[:, 0], kind="stable")] = np.arange(n) * along // max(n, 1)
    order = np.lexsort((points[:, 1], column))
    rank = np.arange(n) - np.searchsorted(column[order], column[order])
    block = np.empty(n, np.intp)
    block[order] = column[order] * along + rank * along // np.bincount(column, minlength=along)[column[order]]
    return block


def _covariance(error: Array, jacobian: Array, group: NDArray[np.intp]) -> Array:
    """(5, 5) of residuals (n,) over the noise and their derivatives (n, 5)."""
    slope = error / (1 + error**2) ** 2  # of the loss, and how it changes
    bend = (1 - 3 * error**2) / (1 + error**2) ** 3
    _, member = np.unique(group, return_inverse=True)
    count = int(member.max()) + 1
    pull, normal = np.zeros((count, 5)), np.zeros((count, 5, 5))
    np.add.at(pull, member, slope[:, None] * jacobian)
    np.add.at(normal, member, bend[:, None, None] * jacobian[:, :, None] * jacobian[:, None])
    rest = normal.sum(0) - normal
    moves = np.einsum("gij,gj->gi", np.linalg.pinv(rest, rcond=UNDETERMINED, hermitian=True), pull)
    covariance = np.asarray((count - 1) / count * moves.T @ moves)
    weight, axes = np.linalg.eigh(rest)
    unknown = np.abs(weight) <= UNDETERMINED * np.abs(weight).max(1, keepdims=True)
    unknown = ((np.abs(axes) >= TAKES_PART) & unknown[:, None]).any((0, 2)) | (count == 1)
    covariance[unknown | unknown[:, None]] = np.inf
    return covariance


def _moved(rotation: Array, translation: Array, by: Array) -> tuple[Array, Array]:
    """A pose moved by three angles about the right camera's axes and two of the direction of t."""
    rotate, _ = cv2.Rodrigues(by[:3])
    direction = translation + _tangent(translation) @ by[3:]
    return rotate @ rotation, direction / np.linalg.norm(direction)


def _residual(rotation: Array, translation: Array, rays: RayPairs) -> Callable[[Array], Array]:
    """Signed Sampson distances (n,) over the noise, as a function of how the pose is moved."""

    def residual(by: Array) -> Array:
        moved, direction = _moved(rotation, translation, by)
        essential = geometry.cross_matrix(direction) @ moved
        return geometry.signed_sampson_distance(essential, rays.left, rays.right) / rays.noise

    return residual


def _jacobian(function: Callable[[Array], Array], step: float = 1e-6) -> Array:
    """(n, 5) derivatives of n values by how the pose is moved."""
    columns = [(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(5)]
    return np.stack(columns, axis=1)


def _tangent(direction: Array) -> Array:
    """(3, 2) orthonormal vectors perpendicular to a unit vector."""
    return np.linalg.svd(direction[None])[2][1:].T
