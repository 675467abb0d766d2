"""Fills small holes of a surface, so that rays do not fall through (paper 3.5.2, (1)).

A hole is a closed loop of edges that have one triangle each: its rim. The rim is projected onto the plane that fits it
best, filled with points as dense as its own, and triangulated (Delaunay). The heights of the new points continue the
surface around the hole: a thin-plate spline through the rim and the vertices next to it. Holes stay open if the rim is
wide, bent, or crosses itself in the plane.
"""

import dataclasses

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

from zpm2.cloud.surface import SurfaceMesh, neighbors_of
from zpm2.config import CloudConfig
from zpm2.model.messages import Note

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_VALENCE = 1000  # how many triangles around a vertex are visited at most
FLAT_RIM = 1e-9  # below this ratio of width to length, a rim is a line


def fill_holes(surface: SurfaceMesh, config: CloudConfig) -> SurfaceMesh:
    """The surface with its small holes filled: those with a diagonal of the rim's box of up to `fill` times the extent.

    The new triangles come last; `SurfaceMesh.filled` counts them. Notes say how many holes were filled and how many
    stayed open.
    """
    widest = config.fill * surface.extent
    if widest <= 0:
        return surface
    loops, tangled = _loops(surface)
    points, faces, count = [surface.vertices], [surface.faces], len(surface.vertices)
    filled = wide = bent = 0
    for loop in loops:
        rim = surface.faces[loop // 3, loop % 3]  # in the orientation of the triangles around the hole
        if _is_outer(surface, loop, rim):
            continue
        if len(rim) > config.max_hole_edges or np.linalg.norm(np.ptp(surface.vertices[rim], axis=0)) > widest:
            wide += 1
            continue
        beside = surface.faces[loop // 3, (loop % 3 + 2) % 3]
        made = _filling(surface.vertices, rim[::-1], beside, config)  # reversed: the filling lies on the other side
        if made is None:
            bent += 1
            continue
        inner, triangles = made
        of = np.r_[rim[::-1], count + np.arange(len(inner))]
        points.append(inner)
        faces.append(of[triangles])
        count += len(inner)
        filled += 1
    notes = [Note(f"{filled} holes were filled")] if filled else []
    notes += [Note(f"{wide} holes are wider than {widest:.3g} and stay open")] if wide else []
    notes += [Note(f"{bent + tangled} holes are too bent to be filled")] if bent + tangled else []
    if not filled:
        return dataclasses.replace(surface, notes=(*surface.notes, *notes))
    triangles = np.concatenate(faces)
    return dataclasses.replace(
        surface,
        vertices=np.concatenate(points),
        faces=triangles,
        neighbors=neighbors_of(triangles)[0],
        notes=(*surface.notes, *notes),
        filled=len(triangles) - len(surface.faces),
    )


def _loops(surface: SurfaceMesh) -> tuple[list[Indices], int]:
    """The closed rims, and the number of rims that are not closed.

    A rim is given by its edges in order; an edge is 3 times the index of its triangle plus the corner where it starts.
    A rim does not close where an edge has more than two triangles or joins triangles of opposite orientation.
    """
    faces, open_ = surface.faces, surface.neighbors < 0
    rim = np.flatnonzero(open_.ravel())
    face, corner = rim // 3, (rim % 3 + 1) % 3  # the edge that starts where this one ends
    pivot = faces[face, corner]
    following = np.full(len(rim), -1, np.int64)
    turning = np.arange(len(rim))
    for _ in range(MAX_VALENCE):  # turn around that vertex to the next open edge
        at = open_[face[turning], corner[turning]]
        ended = turning[at]
        following[ended] = 3 * face[ended] + corner[ended]
        turning = turning[~at]
        if len(turning) == 0:
            break
        face[turning] = surface.neighbors[face[turning], corner[turning]]
        there = faces[face[turning]] == pivot[turning, None]
        corner[turning] = there.argmax(1)
        turning = turning[there.any(1)]
    next_ = np.searchsorted(rim, following)
    known = following >= 0
    every = np.arange(len(rim))
    graph = coo_array((np.ones(int(known.sum())), (every[known], next_[known])), shape=(len(rim), len(rim)))
    n, label = connected_components(graph, directed=False)
    arrivals = np.bincount(next_[known], minlength=len(rim))
    broken = np.zeros(n, bool)
    broken[label[~known | (arrivals != 1)]] = True
    loops = []
    start = np.unique(label, return_index=True)[1]
    size = np.bincount(label, minlength=n)
    for k in np.flatnonzero(~broken):
        loop = np.empty(size[k], np.int64)
        at = start[k]
        for j in range(len(loop)):
            loop[j] = rim[at]
            at = next_[at]
        loops += _without_touching(loop, faces[loop // 3, loop % 3])
    return loops, int(broken.sum())


def _without_touching(loop: Indices, rim: Indices) -> list[Indices]:
    """Splits a rim that passes a vertex more than once (holes touch there) into rims that do not."""
    if len(np.unique(rim)) == len(rim):
        return [loop]
    found: list[Indices] = []
    path: list[int] = []
    at: dict[int, int] = {}
    for edge, vertex in zip(loop.tolist(), rim.tolist(), strict=True):
        if vertex in at:
            found.append(np.array(path[at[vertex] :]))
            for old in path[at[vertex] :]:
                at.pop(int(rim[np.flatnonzero(loop == old)[0]]))
            del path[len(path) - len(found[-1]) :]
        at[vertex] = len(path)
        path.append(edge)
    return [*found, np.array(path)]


def _is_outer(surface: SurfaceMesh, loop: Indices, rim: Indices) -> bool:
    """Whether a rim is the outer border of a surface, not a hole: a filling would lie back to back with the surface."""
    ring = surface.vertices[rim[::-1]] - surface.vertices[rim].mean(0)
    across = np.cross(ring, np.roll(ring, -1, axis=0)).sum(0)
    return bool(surface.normals[loop // 3].sum(0) @ across <= 0)


def _filling(vertices: Array, rim: Indices, beside: Indices, config: CloudConfig) -> tuple[Array, Indices] | None:
    """The (k, 3) new points and the triangles that fill a rim; None for a bent rim.

    Triangles are rows of the rim's points followed by the new ones.
    """
    ring = vertices[rim]
    if len(rim) == 3:
        return np.zeros((0, 3)), np.array([[0, 1, 2]])
    middle = ring.mean(0)
    _, spread, axes = np.linalg.svd(ring - middle, full_matrices=False)
    flat = (ring - middle) @ axes.T
    shape = shapely.Polygon(flat[:, :2])
    width = float(np.linalg.norm(np.ptp(flat, axis=0)))
    bent = np.abs(flat[:, 2]).max() > config.max_hole_bend * width  # such a rim joins two surfaces
    if not shape.is_valid or spread[1] <= FLAT_RIM * spread[0] or bent:
        return None
    step = float(np.linalg.norm(np.roll(flat, -1, axis=0) - flat, axis=1).mean())
    inner = _inside(shape, step)
    triangles = _triangles(flat[:, :2], inner, shape)
    if triangles is None and len(inner):
        inner = np.zeros((0, 2))
        triangles = _triangles(flat[:, :2], inner, shape)
    if triangles is None:
        return None
    if len(inner):
        around = np.concatenate([flat, (vertices[np.setdiff1d(beside, rim)] - middle) @ axes.T])
        around = around[:: -(-len(around) // config.max_hole_support)]
        try:
            height = RBFInterpolator(around[:, :2], around[:, 2], kernel="thin_plate_spline")(inner)
        except np.linalg.LinAlgError:  # all points lie on a line
            return None
        inner = np.c_[inner, height]
    else:
        inner = np.zeros((0, 3))
    a, b, c = (np.r_[flat[:, :2], inner[:, :2]][triangles[:, k]] for k in range(3))
    up = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] > 0
    order = shapely.is_ccw(shape.exterior)
    triangles = np.where((up == order)[:, None], triangles, triangles[:, ::-1])
    return inner @ axes + middle, triangles


def _inside(shape: shapely.Polygon, step: float) -> Array:
    """(k, 2) points of a triangular grid inside a polygon, at least half a step from its rim."""
    low, high = np.array(shape.bounds[:2]), np.array(shape.bounds[2:])
    count = np.ceil((high - low) / [step, step * 0.75**0.5]).astype(int) + 1
    x, y = np.meshgrid(np.arange(count[0]) * step, np.arange(count[1]) * step * 0.75**0.5)
    x[1::2] += step / 2
    points = np.c_[x.ravel(), y.ravel()] + low
    return points[shapely.contains_xy(shape.buffer(-step / 2), points)]


def _triangles(rim: Array, inner: Array, shape: shapely.Polygon) -> Indices | None:
    """Delaunay triangles inside the rim; None if they lack an edge of it.

    Triangles are rows of the rim's points followed by the inner ones.
    """
    points = np.r_[rim, inner]
    try:
        triangles = Delaunay(points).simplices.astype(np.int64)
    except QhullError:
        return None
    shapely.prepare(shape)
    triangles = triangles[shapely.contains_xy(shape, points[triangles].mean(1))]
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    border, count = np.unique(edges, axis=0, return_counts=True)
    n = len(rim)
    wanted = np.sort(np.c_[np.arange(n), np.roll(np.arange(n), -1)], axis=1)
    same = {tuple(e) for e in border[count == 1].tolist()} == {tuple(e) for e in wanted.tolist()}
    if same:
        return triangles
    if len(inner):
        return None
    # triangulate the rim alone, with its edges kept
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    at = np.array([[int(np.abs(rim - p).sum(1).argmin()) for p in t] for t in corners])
    return at.reshape(-1, 3).astype(np.int64)
