"""Shapely's geometries as arrays, and its polygons as ours."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import Polygon


def as_objects(shapes: Sequence[object]) -> NDArray[np.object_]:
    """(n,) an array of shapely geometries, or None; NumPy alone would read some of them as sequences."""
    result = np.empty(len(shapes), object)
    result[:] = shapes
    return result


def from_shape(shape: shapely.Polygon, id: int, score: float = 1.0, label: str | None = None) -> Polygon:
    """A shapely polygon (image px) as ours: exterior with a positive shoelace sum, holes with a negative one."""
    exterior, *holes = rings_of([shape])[0]
    return Polygon(id, exterior, tuple(holes), score, None, label)


def rings_of(shapes: Sequence[shapely.Polygon]) -> list[list[NDArray[np.float64]]]:
    """The rings (n, 2) of each polygon, the exterior first: without the closing vertex, an exterior with a positive
    shoelace sum, holes with a negative one."""
    if not len(shapes):
        return []
    rings, owner = shapely.get_rings(as_objects(shapes), return_index=True)
    vertices, ring = shapely.get_coordinates(rings, return_index=True)
    found: list[list[NDArray[np.float64]]] = [[] for _ in shapes]
    parts = np.split(vertices, np.flatnonzero(np.diff(ring)) + 1)
    for part, of, ccw in zip(parts, owner.tolist(), shapely.is_ccw(rings).tolist(), strict=True):
        inside = bool(found[of])  # not the first ring
        found[of].append(np.ascontiguousarray(part[:-1] if ccw != inside else part[:-1][::-1]))
    return found


def shoelace(ring: NDArray[np.float64]) -> float:
    """The shoelace sum of a ring (n, 2) without its closing vertex: twice its signed area. Exact on whole numbers."""
    x, y = ring.T
    return float(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0])


def reshaped(polygon: Polygon, shape: shapely.Polygon) -> Polygon:
    """The polygon with the outline `shape` (image px). Its id, score, parent and label stay."""
    outline = from_shape(shape, polygon.id)
    return dataclasses.replace(polygon, exterior=outline.exterior, holes=outline.holes)
