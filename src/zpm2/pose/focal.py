"""Estimates the focal length from a fundamental matrix, if it determines one."""

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import FocalConfig
from zpm2.errors import Failed
from zpm2.model import PointMatches

Array = NDArray[np.float64]


def focal_from_points(
    points: PointMatches, sizes: tuple[tuple[int, int], tuple[int, int]], config: FocalConfig, seed: int
) -> tuple[float, float] | Failed:
    """The focal length that both images share and its standard deviation, px; or why the points do not determine it.

    points: inliers of a fundamental matrix, image px. Square pixels and principal points in the middle are assumed.
    Bougnoux' formula (ICCV 1998) for both cameras, their geometric mean; the spread is that of bootstrap samples. Where
    the optical axes meet, as they nearly do in rectified and in turntable pairs, the formula has no solution: the
    spread shows it.
    """
    if len(points) < config.min_points:
        return Failed(
            f"a focal length needs {config.min_points} points on one epipolar geometry, there are {len(points)}"
        )
    middle = np.array(sizes) / 2
    scale = float(max(max(size) for size in sizes))
    left, right = (points.left - middle[0]) / scale, (points.right - middle[1]) / scale
    rng = np.random.default_rng(seed)
    samples = [rng.integers(0, len(left), len(left)) for _ in range(config.samples)]
    found = np.array([_focal(geometry.eight_points(left[rows], right[rows])) for rows in samples])
    good = found[np.isfinite(found)]
    if len(good) < config.min_solved * config.samples:
        return Failed("the epipolar geometry is close to one from which no focal length follows (axes that meet)")
    low, median, high = np.quantile(good, [1 / 6, 0.5, 5 / 6])
    if (high - low) / 2 > config.max_spread * median:
        return Failed(f"the focal length is not determined: {low * scale:.0f} to {high * scale:.0f} px fit alike")
    if not config.low < median < config.high:
        return Failed(f"the focal length comes out as {median * scale:.0f} px, which no usual camera has")
    return float(median * scale), float((high - low) / 2 * scale)


def _focal(fundamental: Array) -> float:
    """The focal length, for coordinates with the principal point at 0; NaN if the formula gives none."""
    squares = [_squared(fundamental), _squared(fundamental.T)]
    return float((squares[0] * squares[1]) ** 0.25) if min(squares) > 0 else float("nan")


def _squared(fundamental: Array) -> float:
    """f^2 of the left camera (Bougnoux 1998)."""
    flat, point = np.diag([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    epipole = np.linalg.svd(fundamental.T)[2][-1]  # of the right image
    across = geometry.cross_matrix(epipole) @ flat @ fundamental
    divisor = point @ across @ flat @ fundamental.T @ point
    dividend = (point @ across @ point) * (point @ fundamental.T @ point)
    return float(-dividend / divisor) if divisor else float("nan")
