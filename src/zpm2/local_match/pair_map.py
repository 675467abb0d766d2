"""The map of each matched pair: where a point of its left polygon should be in the right image."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import LocalConfig
from zpm2.errors import Failed, InputError
from zpm2.global_match import Candidates
from zpm2.local_match.shared_points import shared_points
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons import local_homography
from zpm2.polygons.overlap import iou
from zpm2.polygons.transform import transform_polygons

Array = NDArray[np.float64]


def matched_pairs(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch]
) -> list[tuple[Polygon, Polygon]]:
    """The left and the right polygon of each match. `InputError` if a match names a polygon that does not exist."""
    lefts, rights = ({polygon.id: polygon for polygon in side.polygons} for side in (left, right))
    for match in matches:
        if match.left not in lefts or match.right not in rights:
            raise InputError(f"match {match.left} - {match.right} names a polygon that the result does not have")
    return [(lefts[match.left], rights[match.right]) for match in matches]


def pair_maps(
    left: PolygonArrays, right: PolygonArrays, points: PointMatches, homography: Array | Failed, config: LocalConfig
) -> Array:
    """(n, 3, 3) maps, right ~ map @ left in image px, of n matched pairs: row k of `left` and row k of `right`.

    With `config.gamma` homologous points inside both polygons, the map is a homography fitted to them (paper 3.4.1).
    Otherwise it is one of two hypotheses, whichever makes the polygons overlap more: the local affine part of
    `homography`, moved to the few points available, or the same, scaled and moved so that areas and centroids agree.
    The latter needs neither points nor `homography`, but mistakes a partly hidden polygon for a smaller one.
    """
    linear = _linear(left.centers, homography)
    by_points, count = _by_points(left, right, points, linear, config)
    by_shape = by_areas(left, right, linear)
    each = np.arange(len(left))
    overlap, other = (iou(transform_polygons(left, each, maps), right.shapes) for maps in (by_points, by_shape))
    trusted = (overlap >= other) | ((count >= config.gamma) & (overlap > 0))
    return np.where(trusted[:, None, None], by_points, by_shape)


def by_areas(left: PolygonArrays, right: PolygonArrays, linear: Array) -> Array:
    """(n, 3, 3) affine maps, `linear` (n, 2, 2) up to scale, that bring each left polygon onto its partner: same
    centroid, same area."""
    size = np.sqrt(right.areas / np.maximum(left.areas * np.abs(np.linalg.det(linear)), 1e-300))
    return _affine(size[:, None, None] * linear, left.centers, right.centers)


def _by_points(
    left: PolygonArrays, right: PolygonArrays, points: PointMatches, linear: Array, config: LocalConfig
) -> tuple[Array, NDArray[np.int64]]:
    """(n, 3, 3) maps, which move centroid onto centroid where there are no points, and (n,) the number of points."""
    each = np.arange(len(left))
    maps, points_inside = _affine(linear, left.centers, right.centers), np.zeros(len(left), np.int64)
    inside = shared_points(points, left, right)
    at = inside.at(Candidates(each, each))
    some = np.flatnonzero(at >= 0)
    if len(some) == 0:
        return maps, points_inside
    count = points_inside[some] = inside.counts[at[some]]
    group = np.repeat(np.arange(len(some)), count)
    first = np.cumsum(count) - count
    point = inside.point[np.arange(len(group)) - first[group] + inside.start[at[some]][group]]
    middle = [np.add.reduceat(xy[point], first, axis=0) / count[:, None] for xy in (points.left, points.right)]
    maps[some] = _affine(linear[some], *middle)
    many = count >= config.gamma
    if many.any():
        keep = many[group]
        renumbered = (np.cumsum(many) - 1)[group[keep]]
        maps[some[many]] = local_homography.fit_homographies(
            points, point[keep], renumbered, maps[some[many]], config.homography
        )
    return maps, points_inside


def _linear(centers: Array, homography: Array | Failed) -> Array:
    """(n, 2, 2) the local affine part of H; the identity where there is none."""
    linear: Array = np.tile(np.eye(2), (len(centers), 1, 1))
    if not isinstance(homography, Failed):
        local = geometry.homography_jacobian(homography, centers)
        rows = np.flatnonzero(np.isfinite(local).all((1, 2)))
        rows = rows[np.abs(np.linalg.det(local[rows])) > 1e-6]
        linear[rows] = local[rows]
    return linear


def _affine(linear: Array, source: Array, target: Array) -> Array:
    """(n, 3, 3) maps with the linear part `linear` that bring `source` (n, 2) onto `target` (n, 2)."""
    maps = np.zeros((len(linear), 3, 3))
    maps[:, :2, :2] = linear
    maps[:, :2, 2] = target - np.einsum("nij,nj->ni", linear, source)
    maps[:, 2, 2] = 1.0
    return maps
