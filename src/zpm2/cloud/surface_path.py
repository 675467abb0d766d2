"""Polygon edges of projection surface (paper 3.5.2): paths from point to point along a surface, triangle by triangle.

A path is where the surface meets the plane through the camera's centre and the two points. In the image, this is the
straight edge between them. The paper turns towards the target again in the plane of each triangle (its steps 1 to 4);
such a path depends on the order of the corners and may circle. The section with a plane does neither. It enters a
triangle through one edge and leaves it through another; which one depends on the sides of the plane where the corners
lie. A corner on the plane counts as above it, so that a path through a vertex or along an edge needs no special case.
Every crossing is interpolated between the two ends of its edge, so it lies on the surface. So does the segment between
two crossings, as both are on one triangle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.surface import SurfaceMesh
from zpm2.config import CloudConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# how a path ended: at its target, at a border of the surface, with no edge to cross, or too long
ARRIVED, AT_BORDER, NO_EDGE, TOO_LONG = range(4)


@dataclass(frozen=True, eq=False)
class SurfacePaths:
    """k paths with all their crossings in sequence: path i has the rows start[i] to start[i + 1]."""

    start: Indices  # (k + 1,)
    points: Array  # (c, 3) where the paths cross edges, in the surface's coordinates
    faces: Indices  # (c,) the triangle that each crossing leads into
    ended: Indices  # (k,) `ARRIVED`, or why the path did not arrive; such paths have no crossings

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """(k,) whether each path reached its target."""
        return np.asarray(self.ended == ARRIVED)

    def of(self, row: int) -> tuple[Array, Indices]:
        """The crossings of one path and the triangles that they lead into."""
        rows = slice(self.start[row], self.start[row + 1])
        return self.points[rows], self.faces[rows]


def trace_paths(
    surface: SurfaceMesh,
    begin: tuple[Indices, Array],
    target: tuple[Indices, Array],
    centers: Array,
    config: CloudConfig,
) -> SurfacePaths:
    """k paths, each from a point on the surface to another.

    begin, target: (k,) triangles and (k, 3) points on them. centers: (k, 3) the camera's centre for each path. All
    paths advance together, one crossing per step, so that a step costs only a few array operations. A path ends at its
    target, at a border, after `max_crossings`, or when it is `max_path` times as long as the straight distance.
    """
    count = len(begin[0])
    normal = _plane(begin[1], target[1], centers)
    ended = np.full(count, NO_EDGE, np.int64)
    straight = np.linalg.norm(target[1] - begin[1], axis=1)
    rows: list[Indices] = []
    points: list[Array] = []
    faces: list[Indices] = []
    here = begin[0] == target[0]
    ended[here] = ARRIVED
    active = np.flatnonzero(~here & (np.linalg.norm(normal, axis=1) > 0))
    face, place = begin[0][active], begin[1][active]
    length, entry = np.zeros(len(active)), np.full(len(active), -1, np.int64)
    for _ in range(config.max_crossings):
        if len(active) == 0:
            break
        crossed, at = _crossings(surface, face, normal[active], begin[1][active])
        crossed[np.arange(len(active)), entry] &= entry < 0  # not back through the edge where the path entered
        ahead = np.einsum("nki,ni->nk", at - place[:, None], target[1][active] - place)
        ahead[~crossed] = -np.inf
        leave = ahead.argmax(1)
        each = np.arange(len(active))
        possible = crossed[each, leave]
        point = at[each, leave]
        following = surface.neighbors[face, leave]
        length = length + np.linalg.norm(point - place, axis=1)
        long = length > config.max_path * straight[active] + 1e-12
        ended[active] = np.select([~possible, long, following < 0], [NO_EDGE, TOO_LONG, AT_BORDER], NO_EDGE)
        goes = possible & (following >= 0) & ~long
        rows.append(active[goes])
        points.append(point[goes])
        faces.append(following[goes])
        there = goes & (following == target[0][active])
        ended[active[there]] = ARRIVED
        goes &= ~there
        entry = _edge_of(surface, following, face)[goes]
        active, face, place, length = active[goes], following[goes], point[goes], length[goes]
    return _gathered(count, rows, points, faces, ended)


def _plane(first: Array, second: Array, centers: Array) -> Array:
    """(k, 3) unit normals of the planes through two points and a centre; zero if the three lie on a line."""
    normal = np.cross(first - centers, second - centers)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    scale = np.linalg.norm(first - centers, axis=1, keepdims=True) * np.linalg.norm(second - centers, axis=1)[:, None]
    return np.where(size > 1e-14 * scale, normal / np.maximum(size, 1e-300), 0.0)


def _crossings(surface: SurfaceMesh, face: Indices, normal: Array, through: Array) -> tuple[NDArray[np.bool_], Array]:
    """(k, 3) whether each plane crosses each edge of its triangle, and (k, 3, 3) where."""
    corners = surface.vertices[surface.faces[face]]
    height = np.einsum("nki,ni->nk", corners - through[:, None], normal)
    other, beyond = np.roll(corners, -1, axis=1), np.roll(height, -1, axis=1)
    crossed = (height >= 0) != (beyond >= 0)
    gap = np.where(crossed, height - beyond, 1.0)
    share = np.clip(np.where(crossed, height / gap, 0.0), 0.0, 1.0)
    return crossed, corners + share[..., None] * (other - corners)


def _edge_of(surface: SurfaceMesh, face: Indices, neighbor: Indices) -> Indices:
    """(k,) the edge that each `face` shares with its `neighbor`; -1 if there is no face."""
    edges = surface.neighbors[np.maximum(face, 0)] == neighbor[:, None]
    return np.where(face >= 0, edges.argmax(1), -1)


def _gathered(
    count: int, rows: list[Indices], points: list[Array], faces: list[Indices], ended: Indices
) -> SurfacePaths:

    row = np.concatenate([np.zeros(0, np.int64), *rows])
    point, face = np.concatenate([np.zeros((0, 3)), *points]), np.concatenate([np.zeros(0, np.int64), *faces])
    keep = ended[row] == ARRIVED
    row, point, face = row[keep], point[keep], face[keep]
    order = np.argsort(row, kind="stable")  # steps were taken in order
    start = np.searchsorted(row[order], np.arange(count + 1))
    return SurfacePaths(start, point[order], face[order], ended)
