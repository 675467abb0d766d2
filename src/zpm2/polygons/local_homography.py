"""Fits a separate homography for each polygon to the homologous points inside it (paper 3.4.1)."""

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import HomographyConfig
from zpm2.model import PointMatches

Array = NDArray[np.float64]
# A point pair gives two equations of the 8 unknowns, with coefficients (x, y, 1, 0, 0, 0, -u x, -u y) for u and
# (0, 0, 0, x, y, 1, -v x, -v y) for v. Of the 8 x 8 products of coefficients, summed over both, many are equal or 0.
# Where each is among `_products`, and those of the coefficients with u and v:
SQUARE = np.array(
    [
        [0, 1, 2, 0, 0, 0, 6, 7],
        [1, 3, 4, 0, 0, 0, 8, 9],
        [2, 4, 5, 0, 0, 0, 10, 11],
        [0, 0, 0, 0, 1, 2, 12, 13],
        [0, 0, 0, 1, 3, 4, 14, 15],
        [0, 0, 0, 2, 4, 5, 16, 17],
        [6, 8, 10, 12, 14, 16, 18, 19],
        [7, 9, 11, 13, 15, 17, 19, 20],
    ]
)
IN_SQUARE = np.ones((8, 8))
IN_SQUARE[:3, 3:6] = IN_SQUARE[3:6, :3] = 0.0
TARGET = np.arange(21, 29)


def fit_homographies(
    points: PointMatches, point: NDArray[np.int64], group: NDArray[np.int64], prior: Array, config: HomographyConfig
) -> Array:
    """(g, 3, 3) one homography per group of points, all groups at once.

    `point` (k,) are rows of `points`, `group` (k,) their group 0..g-1 in ascending order, every group with a point;
    `prior` (g, 3, 3) affine maps that decide what the points leave open (collinear points, an extrapolated far corner).
    Linear least squares in normalised coordinates with Cauchy weights: first by the distance to the prior, then by the
    distance to the last solution. The scale of the weights goes from the median residual to `config.residual` px. Each
    matrix is scaled so that the group's mean has depth 1. Scaling to matrix[2, 2] = 1 would fix the depth of the
    image's corner instead, which may be negative for a polygon far from the corner.
    """
    g = len(prior)
    first = np.searchsorted(group, np.arange(g))
    count = np.diff(np.append(first, len(group))).astype(float)
    x, x_mean, x_size = _normalise(points.left[point], group, first, count)
    u, u_mean, u_size = _normalise(points.right[point], group, first, count)
    to_left, from_right = _similarity(x_mean, x_size), _inverse_similarity(u_mean, u_size)
    start = np.linalg.inv(from_right) @ prior @ np.linalg.inv(to_left)  # the prior in normalised coordinates
    start = (start / start[:, 2:, 2:]).reshape(g, 9)[:, :8]
    affine, projective = config.affine_prior, config.projective_prior
    weight_of_prior = np.array([affine, affine, 0, affine, affine, 0, projective, projective]) + 1e-9  # never singular
    products = _products(x, u)
    matrices = np.concatenate([start, np.ones((g, 1))], axis=1).reshape(g, 3, 3)
    for iteration in range(config.iterations):
        mapped = np.einsum("kij,kj->ki", matrices[group], geometry.homogeneous(x))
        depth = np.maximum(mapped[:, 2], 1e-3)
        residual = np.linalg.norm(mapped[:, :2] / depth[:, None] - u, axis=1) * u_size[group]
        scale: float | Array = config.residual
        if iteration < config.wide_iterations:
            scale = np.maximum(scale, _group_median(residual, group, first, count))[group]
        weight = 1.0 / (1.0 + (residual / scale) ** 2) / depth**2
        sums = np.add.reduceat(weight * products, first, axis=1).T
        normal = sums[:, SQUARE] * IN_SQUARE + np.diag(weight_of_prior)
        target = sums[:, TARGET] + weight_of_prior * start
        solution = np.linalg.solve(normal, target[:, :, None])[:, :, 0]
        matrices = np.concatenate([solution, np.ones((g, 1))], axis=1).reshape(g, 3, 3)
    return np.asarray(from_right @ matrices @ to_left)


def _products(x: Array, u: Array) -> Array:
    """(29, k) the products of coefficients that `SQUARE` and `TARGET` name, of (k, 2) points `x` and `u`."""
    (x, y), (u, v), one = x.T, u.T, np.ones(len(x))
    ux, uy, vx, vy = -u * x, -u * y, -v * x, -v * y
    own = [x * x, x * y, x, y * y, y, one]
    with_u = [x * ux, x * uy, y * ux, y * uy, ux, uy]
    with_v = [x * vx, x * vy, y * vx, y * vy, vx, vy]
    both = [ux * ux + vx * vx, ux * uy + vx * vy, uy * uy + vy * vy]
    return np.stack([*own, *with_u, *with_v, *both, x * u, y * u, u, x * v, y * v, v, ux * u + vx * v, uy * u + vy * v])


def _normalise(
    xy: Array, group: NDArray[np.int64], first: NDArray[np.int64], count: Array
) -> tuple[Array, Array, Array]:
    """Points relative to their group's mean, in units of its root mean square radius."""
    mean = np.add.reduceat(xy, first, axis=0) / count[:, None]
    centred = xy - mean[group]
    size = np.sqrt(np.add.reduceat((centred**2).sum(1), first) / count)
    size = np.maximum(size, 1.0)
    return centred / size[group, None], mean, size


def _similarity(mean: Array, size: Array) -> Array:
    matrices = np.zeros((len(mean), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = 1 / size
    matrices[:, :2, 2] = -mean / size[:, None]
    matrices[:, 2, 2] = 1
    return matrices


def _inverse_similarity(mean: Array, size: Array) -> Array:
    matrices = np.zeros((len(mean), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = size
    matrices[:, :2, 2] = mean
    matrices[:, 2, 2] = 1
    return matrices


def _group_median(values: Array, group: NDArray[np.int64], first: NDArray[np.int64], count: Array) -> Array:
    """(g,) the (lower) median of the `values` (k,) of each group; `first` (g,) and `count` (g,) delimit the groups."""
    ordered = values[np.lexsort((values, group))]
    return np.asarray(ordered[first + (count.astype(np.int64) - 1) // 2])
