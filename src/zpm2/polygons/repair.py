"""Geometries that an operation broke or tore, made polygons again."""

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]


def polygons_in(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons with an area of any geometry, whatever it collects."""
    flat = shapely.get_parts(shapely.get_parts(geometry))  # twice: a collection may hold a MultiPolygon
    return [part for part in flat if part.geom_type == "Polygon" and part.area > 0]


def largest(geometry: shapely.Geometry) -> shapely.Polygon:
    """The largest polygon of any geometry; empty where it has none."""
    return max(polygons_in(geometry), key=lambda part: part.area, default=shapely.Polygon())


def mended(shape: shapely.Polygon) -> shapely.Polygon:
    """A polygon whose rings may cross as a valid one: the largest piece of what they enclose.

    Of two ways to read crossed rings the one that loses less: `buffer(0)` goes by the sense in which rings turn and
    drops lobes that turn against the rest, `make_valid` takes what is enclosed twice for outside.
    """
    if shape.is_valid:
        return shape
    ways = [largest(shapely.make_valid(shape)), largest(shapely.buffer(shape, 0))]
    return max(ways, key=lambda way: way.area)
