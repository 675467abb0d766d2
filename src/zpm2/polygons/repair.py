"""Valid polygons from geometries that an operation made invalid or split."""

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


def repaired(shape: shapely.Polygon) -> shapely.Polygon:
    """A valid polygon in place of one whose rings may cross: the largest piece of what they enclose.

    Of the two usual repairs, the one that keeps more area is used: `buffer(0)` drops lobes of the opposite orientation,
    `make_valid` drops areas that are enclosed twice.
    """
    if shape.is_valid:
        return shape
    ways = [largest(shapely.make_valid(shape)), largest(shapely.buffer(shape, 0))]
    return max(ways, key=lambda way: way.area)
