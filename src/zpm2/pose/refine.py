"""The pose that fits the inliers best, and how sure it is."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zpm2 import geometry
from zpm2.pose.estimators import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refined:
    """A pose with its covariance: three angles of rotation about the right camera's axes, two of the direction of t."""

    motion: Motion
    covariance: Array  # (5, 5) rad^2

    @property
    def rotation_sigma(self) -> float:
        """Degrees, one standard deviation of the angle of rotation, all three axes together."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[:3, :3]))))

    @property
    def translation_sigma(self) -> float:
        """Degrees, one standard deviation of the direction of translation."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[3:, 3:]))))


def refine(motion: Motion, left: Array, right: Array, group: NDArray[np.intp], threshold: float) -> Refined:
    """`motion` moved to the least sum of Cauchy-weighted squared Sampson distances of its inliers.

    Rays (n, 2) of the points that the motion was estimated from, `threshold` (same units) the scale of the weights.
    The covariance is the robust (sandwich) one for correlated observations, clustered by `group` (n,): the points of
    one region share the errors of its surface and its texture, so regions are counted, not points (Liang and Zeger,
    Biometrika 1986).
    """
    rows = np.flatnonzero(motion.inliers)
    left, right, group = left[rows], right[rows], group[rows]
    tangent = _tangent(motion.translation)

    def moved(x: Array) -> tuple[Array, Array]:
        turn, _ = cv2.Rodrigues(x[:3])
        direction = motion.translation + tangent @ x[3:]
        return turn @ motion.rotation, direction / np.linalg.norm(direction)

    def residual(x: Array) -> Array:
        rotation, translation = moved(x)
        return geometry.signed_sampson_distance(geometry.cross_matrix(translation) @ rotation, left, right) / threshold

    found = least_squares(residual, np.zeros(5), jac="3-point", loss="cauchy", x_scale=1e-3, max_nfev=50)
    rotation, translation = moved(found.x)
    error = residual(found.x)
    jacobian = _jacobian(residual, found.x)
    push = error / (1 + error**2)  # psi of the Cauchy loss, and its derivative
    bend = np.maximum((1 - error**2) / (1 + error**2) ** 2, 0.0)
    normal = np.linalg.pinv(jacobian.T @ (bend[:, None] * jacobian), rcond=1e-12)
    _, cluster = np.unique(group, return_inverse=True)
    score = np.zeros((cluster.max() + 1, 5))
    np.add.at(score, cluster, push[:, None] * jacobian)
    few = len(score) / max(len(score) - 1, 1)
    covariance = few * normal @ (score.T @ score) @ normal
    return Refined(Motion(rotation, translation, motion.inliers), np.asarray(covariance))


def _jacobian(function: Callable[[Array], Array], x: Array, step: float = 1e-6) -> Array:
    """(n, k) derivatives of n values by k parameters, without the loss that `least_squares` puts into its own."""
    columns = [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))]
    return np.stack(columns, axis=1)


def _tangent(direction: Array) -> Array:
    """(3, 2) orthonormal vectors perpendicular to a unit vector."""
    return np.linalg.svd(direction[None])[2][1:].T
