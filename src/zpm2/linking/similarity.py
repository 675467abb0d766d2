"""The map between two layers: shift, turn and scale, with their uncertainty."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Similarity:
    """right = center + shift + scale R(turn) (left - center); m to the east and north."""

    center: Array  # (2,) m
    shift: Array  # (2,) m, of the centre
    turn: float  # degrees, counter-clockwise
    scale: float = 1.0

    def __call__(self, points: Array) -> Array:
        """(n, 2) left m -> (n, 2) right m."""
        return np.asarray(self.center + self.shift + (points - self.center) @ self.matrix.T)

    @property
    def matrix(self) -> Array:
        """(2, 2) turn and scale."""
        return self.scale * rotation(self.turn)

    def about(self, center: Array) -> "Similarity":
        """The same map, by its shift at another centre."""
        return Similarity(center, self(center[None])[0] - center, self.turn, self.scale)


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of a similarity, at its centre."""

    shift: float  # m, along each axis
    turn: float  # degrees
    scale: float
    residual: float  # m, of one polygon's centre along each axis, by the median


def rotation(degrees: float) -> Array:
    """(2, 2) counter-clockwise."""
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def fitted(left: Array, right: Array, weights: Array) -> Similarity:
    """The weighted least-squares similarity of (n, 2) points, about their weighted centre (Umeyama 1991)."""
    share = weights / weights.sum()
    center, there = share @ left, share @ right
    a, b = left - center, right - there
    dot, cross = share @ (a * b).sum(1), share @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    spread = max(float(share @ (a**2).sum(1)), 1e-12)
    return Similarity(center, there - center, float(np.degrees(np.arctan2(cross, dot))), np.hypot(dot, cross) / spread)
