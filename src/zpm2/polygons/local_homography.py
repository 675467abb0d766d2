"""Fits a separate homography for each polygon to the homologous points inside it (paper 3.4.1)."""

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import HomographyConfig
from zpm2.model import PointMatches

Array = NDArray[np.float64]


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
    zero, one = np.zeros(len(x)), np.ones(len(x))
    rows_u = np.stack([x[:, 0], x[:, 1], one, zero, zero, zero, -u[:, 0] * x[:, 0], -u[:, 0] * x[:, 1]], axis=1)
    rows_v = np.stack([zero, zero, zero, x[:, 0], x[:, 1], one, -u[:, 1] * x[:, 0], -u[:, 1] * x[:, 1]], axis=1)
    matrices = np.concatenate([start, np.ones((g, 1))], axis=1).reshape(g, 3, 3)
    for iteration in range(config.iterations):
        mapped = np.einsum("kij,kj->ki", matrices[group], geometry.homogeneous(x))
        depth = np.maximum(mapped[:, 2], 1e-3)
        residual = np.linalg.norm(mapped[:, :2] / depth[:, None] - u, axis=1) * u_size[group]
        scale: float | Array = config.residual
        if iteration < config.wide_iterations:
            scale = np.maximum(scale, _group_median(residual, group, first, count))[group]
        weight = 1.0 / (1.0 + (residual / scale) ** 2) / depth**2
        square = weight[:, None, None] * (rows_u[:, :, None] * rows_u[:, None] + rows_v[:, :, None] * rows_v[:, None])
        right_side = weight[:, None] * (rows_u * u[:, :1] + rows_v * u[:, 1:])
        normal = np.add.reduceat(square, first, axis=0) + np.diag(weight_of_prior)
        target = np.add.reduceat(right_side, first, axis=0) + weight_of_prior * start
        solution = np.linalg.solve(normal, target[:, :, None])[:, :, 0]
        matrices = np.concatenate([solution, np.ones((g, 1))], axis=1).reshape(g, 3, 3)
    return np.asarray(from_right @ matrices @ to_left)


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
