"""Fewer vertices by Douglas-Peucker (paper 3.2)."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import VectorizeConfig
from zpm2.cores import in_chunks

SHAPE_CHUNK = 16  # shapes that one core simplifies at a time


def simplify(
    shapes: Sequence[shapely.Polygon] | NDArray[np.object_], config: VectorizeConfig, min_area: float
) -> NDArray[np.object_]:
    """(n,) the shapes by Douglas-Peucker, which keeps their topology. A shape stays exact if it would become invalid,
    if its area would change by more than the share `config.max_area_change`, or fall below `min_area` px^2."""
    exact = np.array(shapes, object)
    if not len(exact):
        return exact
    parts = in_chunks(lambda rows: shapely.simplify(exact[rows], config.tolerance), len(exact), SHAPE_CHUNK)
    simple = np.concatenate(parts)
    before, after = shapely.area(exact), shapely.area(simple)
    alike = (np.abs(after - before) <= config.max_area_change * before) & (after >= min_area)
    return np.asarray(np.where(shapely.is_valid(simple) & alike, simple, exact))
