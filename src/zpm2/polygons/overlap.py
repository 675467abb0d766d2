"""How much polygons overlap."""

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]


def iou(first: NDArray[np.object_], second: NDArray[np.object_]) -> Array:
    """(c,) IoU of the two polygons of each row, 0..1."""
    shared = shapely.area(shapely.intersection(first, second))
    union = shapely.area(first) + shapely.area(second) - shared
    return np.asarray(np.where(union > 0, shared / np.maximum(union, 1e-300), 0.0))
