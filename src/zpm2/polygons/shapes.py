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
    holes = tuple(_ring(ring, positive=False) for ring in shape.interiors)
    return Polygon(id, _ring(shape.exterior, positive=True), holes, score, None, label)


def reshaped(polygon: Polygon, shape: shapely.Polygon) -> Polygon:
    """The polygon with the outline `shape` (image px). Its id, score, parent and label stay."""
    outline = from_shape(shape, polygon.id)
    return dataclasses.replace(polygon, exterior=outline.exterior, holes=outline.holes)


def _ring(ring: shapely.LinearRing, positive: bool) -> NDArray[np.float64]:
    """(n, 2) vertices without the closing one, in the order in which the shoelace sum has the wanted sign."""
    vertices = shapely.get_coordinates(ring)[:-1]
    return np.ascontiguousarray(vertices if shapely.is_ccw(ring) == positive else vertices[::-1])
