"""DSF, the deep-spectral factor chi (paper 3.4.2): the homologous points that two polygons share."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.global_match import Candidates
from zpm2.model import PointMatches, PolygonArrays


@dataclass(frozen=True, eq=False)
class SharedPoints:
    """The points inside each pair of polygons, sparse. Those of pair k are `point[start[k] : start[k + 1]]`."""

    pairs: Candidates  # every pair that shares a point, p of them
    start: NDArray[np.int64]  # (p + 1,)
    point: NDArray[np.int64]  # rows of the point matches
    inside: tuple[NDArray[np.int64], NDArray[np.int64]]  # (m,), (n,) points in each left and each right polygon

    @property
    def counts(self) -> NDArray[np.int64]:
        """(p,) chi of each pair."""
        return np.diff(self.start)

    def at(self, pairs: Candidates) -> NDArray[np.int64]:
        """(c,) the row of each of other pairs among `pairs`, -1 where it shares no point."""
        return lookup(np.arange(len(self.pairs)), self.pairs, pairs)

    def counts_of(self, pairs: Candidates) -> NDArray[np.int64]:
        """(c,) chi of other pairs."""
        return lookup(self.counts, self.pairs, pairs).clip(0)

    def agreement(self, pairs: Candidates) -> NDArray[np.float64]:
        """(c,) 0..1, of other pairs the share of the points inside either polygon that are inside both.

        By Laplace's rule of succession, one point in both and one point in only one are added, so that a few points
        have little weight.
        """
        both = self.counts_of(pairs)
        return np.asarray((both + 1) / (self.inside[0][pairs.left] + self.inside[1][pairs.right] - both + 2))


def shared_points(points: PointMatches, left: PolygonArrays, right: PolygonArrays) -> SharedPoints:
    """The points of each pair: left end inside the left polygon and right end inside the right one.

    Time grows linearly with the number of points, and with how deeply polygons are nested.
    """
    point_l, poly_l = _inside(points.left, left)
    point_r, poly_r = _inside(points.right, right)
    first, last = np.searchsorted(point_r, point_l, "left"), np.searchsorted(point_r, point_l, "right")
    count = last - first
    total = int(count.sum())
    row_l = np.repeat(np.arange(len(point_l)), count)
    row_r = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
    i, j, point = poly_l[row_l], poly_r[row_r], point_l[row_l]
    order = np.lexsort((point, j, i))
    i, j, point = i[order], j[order], point[order]
    new = np.ones(len(i), bool)
    new[1:] = (i[1:] != i[:-1]) | (j[1:] != j[:-1])
    start = np.flatnonzero(new)
    inside = np.bincount(poly_l, minlength=len(left)), np.bincount(poly_r, minlength=len(right))
    return SharedPoints(Candidates(i[start], j[start]), np.append(start, len(i)), point, inside)


def lookup(values: NDArray[np.int64], known: Candidates, wanted: Candidates) -> NDArray[np.int64]:
    """(c,) the entry of `values` (one per pair of `known`, which is sorted) for each pair of `wanted`, -1 where
    none."""
    width = 1 + max(known.right.max(initial=0), wanted.right.max(initial=0))
    keys = known.left * width + known.right
    wanted_keys = wanted.left * width + wanted.right
    at = np.minimum(np.searchsorted(keys, wanted_keys), max(len(keys) - 1, 0))
    if len(keys) == 0:
        return np.full(len(wanted), -1, np.int64)
    return np.where(keys[at] == wanted_keys, values[at], -1)


def _inside(points: NDArray[np.float64], polygons: PolygonArrays) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(k,), (k,) rows of the points and of the polygons that contain them, sorted by point."""
    if len(points) == 0 or len(polygons) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    shapely.prepare(polygons.shapes)
    polygon, point = shapely.STRtree(shapely.points(points)).query(polygons.shapes, predicate="contains")
    order = np.lexsort((polygon, point))
    return point[order], polygon[order]
