"""How much polygons overlap."""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cores import in_chunks
from zpm2.model import PolygonArrays

Array = NDArray[np.float64]
ROUNDING = 1e-6  # share of an overlap by which areas may be rounded
SHAPE_CHUNK = 32  # pairs of polygons that one core intersects at a time


def iou(first: NDArray[np.object_], second: NDArray[np.object_], least: float | Array = 0.0) -> Array:
    """(c,) IoU of the two polygons of each row, 0..1.

    Rows whose bounds and areas show that they cannot reach `least`, one number or (c,), are not intersected and get 0.
    """
    areas = shapely.area(first), shapely.area(second)
    rows = np.flatnonzero(may_reach(areas, (shapely.bounds(first), shapely.bounds(second)), least))
    shared = np.zeros(len(areas[0]))
    one, two = first[rows], second[rows]
    areas_of = in_chunks(lambda k: shapely.area(shapely.intersection(one[k], two[k])), len(rows), SHAPE_CHUNK)
    shared[rows] = np.concatenate([np.zeros(0), *areas_of])
    union = areas[0] + areas[1] - shared
    return np.asarray(np.where(union > 0, shared / np.maximum(union, 1e-300), 0.0))


def may_reach(areas: tuple[Array, Array], bounds: tuple[Array, Array], least: float | Array) -> NDArray[np.bool_]:
    """(c,) whether polygons of `areas` (c,) and `bounds` (c, 4) may have an IoU of `least`, one number or (c,)."""
    common = np.minimum(shared_box(*bounds), np.minimum(*areas))
    return np.asarray((common > 0) & (common >= (1 - ROUNDING) * least * (areas[0] + areas[1] - common)))


def beside(
    polygons: PolygonArrays, rows: NDArray[np.int64], others: NDArray[np.int64], max_shared: float
) -> NDArray[np.bool_]:
    """(c,) whether polygon `rows[k]` and polygon `others[k]` of one photograph lie beside each other.

    They share at most `max_shared` of the smaller one's area."""
    most = max_shared * np.minimum(polygons.areas[rows], polygons.areas[others])
    found = shared_box(polygons.bounds[rows], polygons.bounds[others]) <= most
    near = np.flatnonzero(~found)
    common = shapely.intersection(polygons.shapes[rows[near]], polygons.shapes[others[near]])
    found[near] = shapely.area(common) <= most[near]
    return np.asarray(found)


def shared_box(first: Array, second: Array) -> Array:
    """(c,) area of what the two boxes (c, 4) of each row share. NaN where one is that of an empty polygon."""
    sides = np.minimum(first[:, 2:], second[:, 2:]) - np.maximum(first[:, :2], second[:, :2])
    width, height = np.maximum(sides, 0.0).T
    return np.asarray(width * height)
