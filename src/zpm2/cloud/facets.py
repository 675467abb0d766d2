"""Cuts faces with more than three corners into triangles."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
FLAT_TRIANGLE = 1e-9  # share of a face's area: with a smaller triangle, a fan would leave out a corner
AREA_TOLERANCE = 1e-6  # how much the area of a face may differ from its triangles', as a share


def triangulate(vertices: Array, faces: Sequence[Indices]) -> tuple[Indices, list[str]]:
    """(t, 3) triangles, oriented like their faces, and notes on faces at fault.

    faces: an array (m, k) of vertex indices for each number of corners k.

    A face becomes a fan from its first corner if all triangles of the fan have the face's orientation, as those of
    convex faces do. Other faces are cut in the plane that fits them best (constrained Delaunay triangulation, which
    keeps their edges), even if a bridge joins a hole to their border. A face that crosses itself becomes a fan anyway.
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
            points[~np.isfinite(points).all((1, 2))] = 0  # `SurfaceMesh.of` leaves these out
            crosses = np.cross(points[:, 1:-1], points[:, 2:])
            normal = crosses.sum(1)  # its length is twice the area
            size = np.einsum("mi,mi->m", normal, normal)
            bent = (np.einsum("mki,mi->mk", crosses, normal) <= FLAT_TRIANGLE * size[:, None]).any(1) & (size > 0)
            cut, crossed = _cut(corners[bent], points[bent], normal[bent])
            found.append(cut)
            crossing += len(crossed)
            fan = np.concatenate([fan[~bent], fan[bent][crossed]])
        found.append(fan.reshape(-1, 3))
    odd = [
        (crossing, "faces cross themselves, so their triangles overlap"),
        (short, "faces have fewer than three corners"),
    ]
    return np.concatenate(found), [f"{count} {text}" for count, text in odd if count]


def _cut(corners: Indices, points: Array, normal: Array) -> tuple[Indices, Indices]:
    """The triangles of m faces with vertices (m, k) at points (m, k, 3), and the rows of faces that cannot be cut."""
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
    """The triangles of each shape. A shape that GEOS cannot cut gives none; the others are cut all the same."""
    try:
        return np.asarray(shapely.constrained_delaunay_triangles(shapes), object)
    except shapely.errors.GEOSException:
        if len(shapes) == 1:
            return np.array([shapely.GeometryCollection()], object)
        half = len(shapes) // 2
        return np.concatenate([_pieces(shapes[:half]), _pieces(shapes[half:])])
