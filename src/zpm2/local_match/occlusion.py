"""The parts of polygons that both photographs can show, where something in front hides a part in one of them.

What is in front moves otherwise than what is behind it. So if two polygons lie beside each other in both photographs,
and the map of one takes it onto the other, the other one hides it there.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.global_match import Candidates
from zpm2.model import PolygonArrays
from zpm2.polygons.overlap import beside
from zpm2.polygons.transform import transform_polygons

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Shapes = NDArray[np.object_]


def unhidden(
    warped: Shapes,
    right: Shapes,
    pairs: Candidates,
    maps: Array,
    polygons: tuple[PolygonArrays, PolygonArrays],
    matched: Candidates,
    max_shared: float,
) -> tuple[Shapes, Shapes]:
    """Of c pairs, the `warped` left and the `right` polygons (c,) without what other matches hide of them.

    `maps` (c, 3, 3) lead from left to right, right image px. `pairs` and `matched` are rows of the `polygons`. A match
    hides something of a pair if, in each photograph, its polygon lies beside that of the pair: they share at most
    `max_shared` of the smaller one. Its right polygon then hides what it covers of the warped left one. Its left
    polygon, mapped as the pair's, covers what the left photograph does not show of the right one.
    """
    if not len(matched):
        return warped, right
    left = polygons[0].bounds[pairs.left]
    size = left[:, 2:] - left[:, :2]
    around = shapely.box(*np.c_[left[:, :2] - size, left[:, 2:] + size].T)  # what a map of one polygon still holds for
    fronts = polygons[0].shapes[matched.left], polygons[1].shapes[matched.right]
    row, match = _beside_both(around, fronts[0], pairs, polygons, matched, max_shared)
    other = _without(right, row, transform_polygons(polygons[0], matched.left[match], maps[row]))
    row, match = _beside_both(warped, fronts[1], pairs, polygons, matched, max_shared)
    return _without(warped, row, fronts[1][match]), other


def _beside_both(
    shapes: Shapes,
    fronts: Shapes,
    pairs: Candidates,
    polygons: tuple[PolygonArrays, PolygonArrays],
    matched: Candidates,
    max_shared: float,
) -> tuple[Rows, Rows]:
    """Rows of the pairs, ascending, and of the matches that lie beside them in both photographs, where a shape (c,) of
    the pair meets one of the match's `fronts` (m,)."""
    row, match = shapely.STRtree(fronts).query(shapes, predicate="intersects")
    for side, own, others in zip(polygons, (pairs.left, pairs.right), (matched.left, matched.right), strict=True):
        apart = beside(side, own[row], others[match], max_shared)
        row, match = row[apart], match[apart]
    order = np.lexsort((match, row))
    return row[order], match[order]


def _without(shapes: Shapes, rows: Rows, fronts: Shapes) -> Shapes:
    """The shapes less what the `fronts` (f,) cover; front k hides a part of shape `rows[k]`.

    One after the other: most of them cut little off, and their union costs five times as much."""
    result = shapes.copy()
    for row, front in zip(rows, fronts, strict=True):
        result[row] = shapely.difference(result[row], front)
    return result
