"""Where each polygon of one image should be in the other, from the homologous points alone.

The pyramid needs texture at a polygon's centre and gives a place; this gives a whole map, also for what has no texture:
from the points inside the polygon, else from those around it.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.errors import Failed
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons import local_homography
from zpm2.polygons.transform import transformed

Array = NDArray[np.float64]
AROUND = 8  # points nearest to a polygon that has none of its own


@dataclass(frozen=True, eq=False)
class WarpedPolygons:
    """n polygons in the other image."""

    maps: Array  # (n, 3, 3) other ~ map @ own, image px
    shapes: NDArray[np.object_]  # (n,) shapely polygons, other image px; empty where there is no saying
    own: NDArray[np.int64]  # (n,) homologous points inside the polygon

    def __len__(self) -> int:
        return len(self.maps)


def warp_by_points(
    polygons: PolygonArrays, points: PointMatches, homography: Array | Failed, gamma: int
) -> WarpedPolygons:
    """The polygons of the points' left image, as its right one should show them.

    With `gamma` points inside, a polygon has a homography of its own (3.4.1). With fewer, the local affine part of H
    goes to the median place to which these lead, and without any, to that of the nearest `AROUND` points.
    """
    n = len(polygons)
    if n == 0 or len(points) == 0:
        return WarpedPolygons(
            np.broadcast_to(np.eye(3), (n, 3, 3)), np.full(n, shapely.Polygon(), object), np.zeros(n, int)
        )
    tree = shapely.STRtree(shapely.points(points.left))
    shapely.prepare(polygons.shapes)
    polygon, point = tree.query(polygons.shapes, predicate="contains")
    order = np.lexsort((point, polygon))
    polygon, point = polygon[order], point[order]
    own = np.bincount(polygon, minlength=n)
    _, near = cKDTree(points.left).query(polygons.centers, k=min(AROUND, len(points)))
    near = near.reshape(n, -1)
    bare = np.flatnonzero(own == 0)
    polygon = np.append(polygon, np.repeat(bare, near.shape[1]))
    point = np.append(point, near[bare].ravel())
    order = np.argsort(polygon, kind="stable")
    polygon, point = polygon[order], point[order]
    maps = _moved(polygons.centers, points, polygon, point, homography)
    rich = own >= gamma
    if rich.any():
        keep = rich[polygon]
        renumbered = (np.cumsum(rich) - 1)[polygon[keep]]
        maps[rich] = local_homography.fit_homographies(points, point[keep], renumbered, maps[rich])
    return WarpedPolygons(maps, transformed(polygons, np.arange(n), maps), own)


def _moved(
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
