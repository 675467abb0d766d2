"""The points that a pose is estimated from: C = M1f + M2, each with the matched region it lies in (paper 3.5.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.features.combined import distinct
from zpm2.local_match.shared_points import shared_points
from zpm2.model import PointMatches, PolygonArrays
from zpm2.model.brief import brief

SAME_PX = 2.0  # px, in both images: two points of different origin that are closer are one


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
    """(n,) the matched pair (row k of `left` and of `right`) that holds each point on both sides; -1 where none does.

    Of several, nested ones, the one of the smallest left polygon: so each point has one region, and regions exclude
    each other, as the paper wants it.
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


def union(known: Correspondences, more: Correspondences) -> Correspondences:
    """Both, without points of one that the other has too; of two such points the better score stays."""
    together = Correspondences(
        PointMatches.join([known.points, more.points]),
        np.concatenate([known.region, more.region]),
        np.concatenate([known.local, more.local]),
    )
    return together[distinct(together.points, SAME_PX)]


def cell_of(points: PointMatches, size: tuple[int, int], cells: int) -> NDArray[np.intp]:
    """(n,) which of `cells` x `cells` cells of a left image of `size` px each point lies in, row by row from 0."""
    column, row = np.minimum((points.left * cells / np.array(size)).astype(np.intp), cells - 1).clip(0).T
    return np.asarray(row * cells + column)


def spread(points: PointMatches, size: tuple[int, int], cells: int, most: int) -> NDArray[np.bool_]:
    """(n,) which points to keep, at most `most` in each of `cells` x `cells` cells of the left image, best first."""
    cell = cell_of(points, size, cells)
    order = np.lexsort((-points.score, cell))
    first = np.searchsorted(cell[order], cell[order])
    keep = np.zeros(len(points), bool)
    keep[order[np.arange(len(order)) - first < most]] = True
    return keep
