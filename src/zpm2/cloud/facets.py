"""Faces of many corners cut into triangles."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
FLAT_TRIANGLE = 1e-9  # of a face's area: a thinner triangle of a fan would leave out a corner
AREA_TOLERANCE = 1e-6  # share by which the areas of a face and of its triangles may differ


def triangulate(vertices: Array, faces: Sequence[Indices]) -> tuple[Indices, list[str]]:
    """(t, 3) triangles of faces, (m, k) for each number k of corners, oriented as the faces are, and notes on odd ones.

    A face whose fan from its first corner has only triangles of its own orientation is that fan: all convex ones are.
    Others are cut in the plane that fits them best, with their edges kept (constrained Delaunay triangulation), even
    with holes that a bridge joins to the border. Only a face that crosses itself is made a fan nonetheless.
    """
    found, crossing, short = [np.zeros((0, 3), np.int64)], 0, 0
    for corners in faces:
        k = corners.shape[1]
        if k < 3:
            short += len(corners)
            continue
        fan = np.stack(
            [np.broadcast_to(corners[:, :1], (len(corners), k - 2)), corners[:, 1:-1], corners[:, 2:]], axis=2
        )
        if k > 3:
            points = vertices[corners] - vertices[corners[:, :1]]
            points[~np.isfinite(points).all((1, 2))] = 0  # left out by `SurfaceMesh.of`
            crosses = np.cross(points[:, 1:-1], points[:, 2:])
            normal = crosses.sum(1)  # twice the area long
            size = np.einsum("mi,mi->m", normal, normal)
            bent = (np.einsum("mki,mi->mk", crosses, normal) <= FLAT_TRIANGLE * size[:, None]).any(1) & (size > 0)
            cut, crossed = _cut(corners[bent], points[bent], normal[bent])
            found.append(cut)
            crossing += len(crossed)
            fan = np.concatenate([fan[~bent], fan[bent][crossed]])
        found.append(fan.reshape(-1, 3))
    odd = [
        (crossing, "faces cross themselves: their triangles overlap"),
        (short, "faces have fewer than three corners"),
    ]
    return np.concatenate(found), [f"{count} {text}" for count, text in odd if count]


def _cut(corners: Indices, points: Array, normal: Array) -> tuple[Indices, Indices]:
    """The triangles of m faces, (m, k) vertices at (m, k, 3), and the rows of those that cannot be cut."""
    if len(corners) == 0:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    up = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(up).argmin(1)]
    x = np.cross(least, up)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    flat = np.einsum("mki,mji->mkj", points, np.stack([x, np.cross(up, x)], axis=1))  # anticlockwise
    parts, of = shapely.get_parts(_pieces(shapely.polygons(flat)), return_index=True)
    ends = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    x0, y0 = (ends[:, 1] - ends[:, 0]).T
    x1, y1 = (ends[:, 2] - ends[:, 0]).T
    twice = x0 * y1 - y0 * x1
    away = np.abs(np.bincount(of, np.abs(twice), len(flat)) - np.linalg.norm(normal, axis=1))
    good = away <= AREA_TOLERANCE * np.linalg.norm(normal, axis=1)
    ends, of, twice = ends[good[of]], of[good[of]], twice[good[of]]
    at = np.stack([np.abs(flat[of] - ends[:, j, None]).sum(2).argmin(1) for j in range(3)], axis=1)
    triangles = np.take_along_axis(corners[of], at, axis=1)
    return np.where((twice > 0)[:, None], triangles, triangles[:, ::-1]), np.flatnonzero(~good)


def _pieces(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    """The triangles of each shape. One that GEOS cannot cut gives none, and does not keep the others from being cut."""
    try:
        return np.asarray(shapely.constrained_delaunay_triangles(shapes), object)
    except shapely.errors.GEOSException:
        if len(shapes) == 1:
            return np.array([shapely.GeometryCollection()], object)
        half = len(shapes) // 2
        return np.concatenate([_pieces(shapes[:half]), _pieces(shapes[half:])])
