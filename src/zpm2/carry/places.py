"""Where regions of the left photograph should be in the right one, by homologous points.

Most regions belong to the scene and move as its points do (`polygons.warp`). A region that moves on its own disagrees
with that, but its own points agree on a motion of their own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.config import CarryConfig, LocalConfig
from zpm2.global_match import InitialGeometry
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons.shapes import from_shape
from zpm2.polygons.transform import transform_polygons
from zpm2.polygons.warp import warp_by_points

Array = NDArray[np.float64]
MOTION_POINTS = 4  # two fix a similarity, two more must agree


@dataclass(frozen=True, eq=False)
class Places:
    """n regions of the left photograph, moved into the right one by points."""

    shapes: NDArray[np.object_]  # (n,) right px, beyond the border too; empty where no map is known
    maps: Array  # (n, 3, 3) right ~ map @ left, image px, of the largest part of each
    trust: Array  # (n,) 0..1, how much the points say that this is the place
    agreeing: NDArray[np.int64]  # (n,) homologous points inside the region that agree with the map
    sigma: Array  # (n,) px, standard deviation of the place along each axis; NaN where fewer than three points tell
    surrounded: Array  # (n,) 0..1, share of each region among the points of the scene: within their convex hull
    pair_points: int = 0  # of the whole pair that agree on one geometry


def places(shapes: NDArray[np.object_], initial: InitialGeometry, config: CarryConfig, warp: LocalConfig) -> Places:
    """The (n,) shapes, left px, where the points of a pair put them."""
    n, points = len(shapes), initial.points
    part, owner = shapely.get_parts(shapes, return_index=True)
    arrays = PolygonArrays([from_shape(each, k) for k, each in enumerate(part)])
    forward = initial.forward()
    maps = warp_by_points(arrays, *forward, warp).maps.copy()
    span = np.hypot(*(arrays.bounds[:, 2:] - arrays.bounds[:, :2]).T)
    reach = np.maximum(config.agree_px, config.agree_share * span)
    trust, sigma, agreeing = np.zeros(len(part)), np.full(len(part), np.nan), np.zeros(len(part), np.int64)
    own = _points_inside(arrays, points)
    known = forward[0] if initial.supported else PointMatches.empty()
    near_points = cKDTree(known.left) if len(known) else None
    for k, rows in enumerate(own):
        if len(rows):
            some = points[rows]
            good = _errors(maps[k], some) <= reach[k]
            if len(rows) >= MOTION_POINTS and 2 * good.sum() < len(rows):
                maps[k], good = _own_motion(some, maps[k], good, float(reach[k]))
            agreeing[k] = good.sum()
            trust[k] = agreeing[k] ** 2 / ((agreeing[k] + config.few_points) * len(rows))
            sigma[k] = _sigma(maps[k], some[good])
        elif near_points is not None:
            distance, near = near_points.query(arrays.centers[k], k=min(warp.nearest_points, len(known)))
            distance, near = np.atleast_1d(distance), np.atleast_1d(near)
            good = _errors(maps[k], known[near]) <= np.maximum(reach[k], config.agree_share * distance)
            trust[k] = config.neighbors_trust * good.mean() / (1 + (np.median(distance) / (2 * span[k])) ** 2)
            sigma[k] = _sigma(maps[k], known[near][good])
    moved = transform_polygons(arrays, np.arange(len(part)), maps)
    first = np.searchsorted(owner, np.arange(n))
    weight = arrays.areas / np.maximum(np.bincount(owner, arrays.areas, n)[owner], 1e-300)
    return Places(
        np.array([shapely.unary_union(moved[owner == k]) for k in range(n)], object),
        maps[first] if n else np.zeros((0, 3, 3)),
        np.asarray(np.bincount(owner, weight * trust, n), np.float64),
        np.bincount(owner, agreeing, n).astype(np.int64),
        sigma[first] if n else sigma,
        _surrounded(shapes, known),
        initial.agreeing,
    )


def _surrounded(shapes: NDArray[np.object_], points: PointMatches) -> Array:
    """(n,) 0..1, the share of each shape, left px, within the convex hull of points: beyond it they say less."""
    hull = shapely.MultiPoint(points.left).convex_hull
    return np.asarray(shapely.area(shapely.intersection(shapes, hull)) / np.maximum(shapely.area(shapes), 1e-300))


def _points_inside(arrays: PolygonArrays, points: PointMatches) -> list[NDArray[np.intp]]:
    """Of each polygon, the rows of the left points in it."""
    if not len(points):
        return [np.zeros(0, np.intp)] * len(arrays)
    shapely.prepare(arrays.shapes)
    polygon, point = shapely.STRtree(shapely.points(points.left)).query(arrays.shapes, predicate="contains")
    order = np.lexsort((point, polygon))
    return np.split(point[order], np.searchsorted(polygon[order], np.arange(len(arrays))))[1:]


def _errors(matrix: Array, points: PointMatches) -> Array:
    """(n,) px, how far each left point, mapped, is from its right one; NaN beyond the horizon."""
    return np.asarray(np.linalg.norm(geometry.project(matrix, points.left) - points.right, axis=1))


def _own_motion(
    points: PointMatches, usual: Array, good: NDArray[np.bool_], reach: float
) -> tuple[Array, NDArray[np.bool_]]:
    """A similarity on which more of a region's own points agree than on the `usual` map, else that; and the (n,)
    points that agree."""
    found, inliers = cv2.estimateAffinePartial2D(
        points.left, points.right, method=cv2.RANSAC, ransacReprojThreshold=reach
    )
    if found is None or inliers.sum() <= max(good.sum(), MOTION_POINTS - 1):
        return usual, good
    return np.vstack([found, [0.0, 0.0, 1.0]]), inliers.ravel().astype(bool)


def _sigma(matrix: Array, points: PointMatches) -> float:
    """Px, the standard deviation of the mean place that the points tell (robust; NaN for fewer than three)."""
    if len(points) < 3:
        return float("nan")
    residual = points.right - geometry.project(matrix, points.left)
    spread = 1.4826 * np.median(np.abs(residual - np.median(residual, axis=0)), axis=0)
    return float(np.sqrt((spread**2).mean() / len(points)))
