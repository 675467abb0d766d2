"""Fewer vertices by Douglas-Peucker (paper 3.2)."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

AREA_CHANGE = 0.2  # share of a polygon's area that simplification may add or take


def simplify(shapes: Sequence[shapely.Polygon], tolerance: float, min_area: float) -> NDArray[np.object_]:
    """Douglas-Peucker that keeps topology; a shape that it would break or change too much stays exact."""
    exact = np.array(shapes, object)
    if not len(exact):
        return exact
    simple = shapely.simplify(exact, tolerance, preserve_topology=True)
    before, after = shapely.area(exact), shapely.area(simple)
    alike = (np.abs(after - before) <= AREA_CHANGE * before) & (after >= min_area)
    return np.asarray(np.where(shapely.is_valid(simple) & alike, simple, exact))
