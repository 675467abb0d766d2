"""Warps each polygon of one image into the other, by the homologous points alone.

The pyramid (`global_match.pyramid`) needs texture at a polygon's centre and finds only a location. The points in or
around a polygon give a whole map and need no texture.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.config import LocalConfig
from zpm2.errors import Failed
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons import local_homography
from zpm2.polygons.once import Known, each_once, identity, vertices
from zpm2.polygons.shapes import as_objects
from zpm2.polygons.transform import transform_polygons

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WarpedPolygons:
    """n polygons in the other image."""

    maps: Array  # (n, 3, 3) other ~ map @ own, image px
    shapes: NDArray[np.object_]  # (n,) shapely polygons, other image px; empty where no map is known
    own: NDArray[np.int64]  # (n,) homologous points inside the polygon

    def __len__(self) -> int:
        return len(self.maps)


@dataclass(frozen=True, eq=False)
class WarpingPoints(PointMatches):
    """Points that warp many polygons, most of them more than once in a run: `warp_by_points` builds their trees once,
    and warps each polygon once."""

    known: Known[tuple[Array, shapely.Polygon, int]] = field(default_factory=dict, init=False)

    def __reduce__(self) -> tuple[object, ...]:
        """Copies know nothing: keys name objects of this process."""
        return WarpingPoints, (self.left, self.right, self.score)

    @staticmethod
    def of(points: PointMatches) -> "WarpingPoints":
        """The same points."""
        if isinstance(points, WarpingPoints):
            return points
        return WarpingPoints(points.left, points.right, points.score)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Of the left points."""
        return shapely.STRtree(shapely.points(self.left))

    @cached_property
    def neighbors(self) -> "cKDTree[None]":
        """Of the left points."""
        return cKDTree(self.left)


def warp_by_points(
    polygons: PolygonArrays, points: PointMatches, homography: Array | Failed, config: LocalConfig
) -> WarpedPolygons:
    """The polygons of the points' left image, as the right one should show them.

    A polygon with at least `config.gamma` points has a homography of its own (3.4.1). With fewer, it moves by the local
    affine part of H and the median shift of its points; without any, by that of the `config.nearest_points` nearest.
    Of `WarpingPoints`, a polygon with the same vertices (the same arrays) is not warped twice.
    """
    points, n = WarpingPoints.of(points), len(polygons)
    if n == 0 or len(points) == 0:
        return WarpedPolygons(
            np.broadcast_to(np.eye(3), (n, 3, 3)), np.full(n, shapely.Polygon(), object), np.zeros(n, int)
        )

    def find(rows: NDArray[np.intp]) -> list[tuple[Array, shapely.Polygon, int]]:
        some = PolygonArrays([polygons.polygons[row] for row in rows])
        found = _warped(some, points, homography, config)
        return list(zip(found.maps, found.shapes, found.own, strict=True))

    keys = [(*identity(polygon), id(homography), id(config)) for polygon in polygons.polygons]
    maps, shapes, own = zip(
        *each_once(points.known, keys, lambda row: (*vertices(polygons.polygons[row]), homography, config), find),
        strict=True,
    )
    return WarpedPolygons(np.array(maps), as_objects(shapes), np.array(own))


def _warped(
    polygons: PolygonArrays, points: WarpingPoints, homography: Array | Failed, config: LocalConfig
) -> WarpedPolygons:
    """What `warp_by_points` gives for polygons that are not known. Rows do not depend on each other."""
    n = len(polygons)
    shapely.prepare(polygons.shapes)
    polygon, point = points.tree.query(polygons.shapes, predicate="contains")
    order = np.lexsort((point, polygon))
    polygon, point = polygon[order], point[order]
    own = np.bincount(polygon, minlength=n)
    _, near = points.neighbors.query(polygons.centers, k=min(config.nearest_points, len(points)))
    near = near.reshape(n, -1)
    without = np.flatnonzero(own == 0)
    polygon = np.append(polygon, np.repeat(without, near.shape[1]))
    point = np.append(point, near[without].ravel())
    order = np.argsort(polygon, kind="stable")
    polygon, point = polygon[order], point[order]
    maps = _affine_maps(polygons.centers, points, polygon, point, homography)
    many = own >= config.gamma
    if many.any():
        keep = many[polygon]
        renumbered = (np.cumsum(many) - 1)[polygon[keep]]
        maps[many] = local_homography.fit_homographies(points, point[keep], renumbered, maps[many], config.homography)
    return WarpedPolygons(maps, transform_polygons(polygons, np.arange(n), maps), own)


def _affine_maps(
    centers: Array, points: PointMatches, polygon: NDArray[np.int64], point: NDArray[np.int64], h: Array | Failed
) -> Array:
    """(n, 3, 3) affine maps: the linear part of H at the polygon's centre, and the median shift of its points."""
    n = len(centers)
    linear: Array = np.tile(np.eye(2), (n, 1, 1))
    if not isinstance(h, Failed):
        local = geometry.homography_jacobian(h, centers)
        finite = np.isfinite(local).all(axis=(1, 2))
        linear[finite] = local[finite]
    shift = points.right[point] - np.einsum("kij,kj->ki", linear[polygon], points.left[point])
    maps = np.zeros((n, 3, 3))
    maps[:, :2, :2], maps[:, 2, 2] = linear, 1.0
    first = np.searchsorted(polygon, np.arange(n))
    count = np.bincount(polygon, minlength=n)
    middle = first + (count - 1) // 2
    for axis in range(2):
        maps[:, axis, 2] = shift[np.lexsort((shift[:, axis], polygon)), axis][middle]
    return maps
