"""Polygons through 3 x 3 maps."""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.model import PolygonArrays
from zpm2.polygons.repair import repaired

Array = NDArray[np.float64]


def transform_polygons(polygons: PolygonArrays, rows: NDArray[np.int64], matrices: Array) -> NDArray[np.object_]:
    """(c,) shapely polygons: polygon `rows[k]`, with its holes, mapped by `matrices[k]` (c, 3, 3).

    Polygons whose rings cross after that are repaired. A polygon with a vertex beyond the horizon becomes empty."""
    if len(rows) == 0:
        return np.empty(0, object)
    coords, owner = shapely.get_coordinates(polygons.shapes[rows], return_index=True)
    mapped = np.einsum("kij,kj->ki", matrices[owner], geometry.homogeneous(coords))
    beyond = mapped[:, 2] <= 1e-6
    mapped[beyond, 2] = 1.0
    shapes = shapely.set_coordinates(polygons.shapes[rows], mapped[:, :2] / mapped[:, 2:])
    invalid = ~shapely.is_valid(shapes)
    shapes[invalid] = [repaired(shape) for shape in shapes[invalid]]
    shapes[np.unique(owner[beyond])] = shapely.Polygon()
    return np.asarray(shapes)
