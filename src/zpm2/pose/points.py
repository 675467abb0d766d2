"""The points that a pose is estimated from: C = M1f + M2, each with the matched region it lies in (paper 3.5.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.features.combined import distinct
from zpm2.local_match.shared_points import shared_points
from zpm2.model import PointMatches, PolygonArrays
from zpm2.model.brief import brief

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RayPairs:
    """Homologous rays of two calibrated cameras (x / z, y / z), and how exact they are."""

    left: Array  # (n, 2)
    right: Array  # (n, 2)
    noise: float  # of a ray: the estimator's threshold, px / focal length

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "RayPairs":
        return RayPairs(self.left[rows], self.right[rows], self.noise)

    def distance(self, essential: Array) -> Array:
        """(n,) Sampson distances, units of rays."""
        return geometry.sampson_distance(essential, self.left, self.right)

    def near(self, essential: Array, reach: float) -> NDArray[np.bool_]:
        """(n,) which rays lie within `reach` times their noise of their epipolar lines."""
        return np.asarray(self.distance(essential) <= reach * self.noise)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Homologous points, image px, with what each belongs to."""

    points: PointMatches
    region: NDArray[np.intp]  # (n,) row of the matched pair that a point lies in, -1 for none
    local: NDArray[np.bool_]  # (n,) found in a crop (M2), not in the whole images (M1)

    __repr__ = brief

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "Correspondences":
        return Correspondences(self.points[rows], self.region[rows], self.local[rows])


def region_of(points: PointMatches, left: PolygonArrays, right: PolygonArrays) -> NDArray[np.intp]:
    """(n,) the matched pair (row k of `left` and of `right`) whose polygons contain the point in both images, or -1.

    If regions are nested, a point belongs to the one with the smallest left polygon. So each point has one region, and
    regions exclude each other, as in the paper.
    """
    region = np.full(len(points), -1, np.intp)
    inside = shared_points(points, left, right)
    pair = np.repeat(np.arange(len(inside.pairs)), inside.counts)
    i, j, point = inside.pairs.left[pair], inside.pairs.right[pair], inside.point
    matched = i == j
    i, point = i[matched], point[matched]
    order = np.argsort(-left.areas[i], kind="stable")
    region[point[order]] = i[order]  # the last one written is the smallest
    return region


def union(known: Correspondences, more: Correspondences, radius: float) -> Correspondences:
    """Both sets without duplicates: of two points less than `radius` px apart in both images, the better one stays."""
    together = Correspondences(
        PointMatches.join([known.points, more.points]),
        np.concatenate([known.region, more.region]),
        np.concatenate([known.local, more.local]),
    )
    return together[distinct(together.points, radius)]


def cell_of(points: PointMatches, size: tuple[int, int], cells: int) -> NDArray[np.intp]:
    """(n,) which of `cells` x `cells` cells of a left image of `size` px each point lies in, row by row from 0."""
    column, row = np.minimum((points.left * cells / np.array(size)).astype(np.intp), cells - 1).clip(0).T
    return np.asarray(row * cells + column)


def spread(points: PointMatches, size: tuple[int, int], cells: int, limit: int) -> NDArray[np.bool_]:
    """(n,) which points to keep, at most `limit` in each of `cells` x `cells` cells of the left image, best first."""
    cell = cell_of(points, size, cells)
    order = np.lexsort((-points.score, cell))
    first = np.searchsorted(cell[order], cell[order])
    keep = np.zeros(len(points), bool)
    keep[order[np.arange(len(order)) - first < limit]] = True
    return keep
