"""Matching by outline alone: every left polygon against every right one, then the optimal assignment."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from zpm2.baselines.histograms import Costs, Counts, compare
from zpm2.baselines.method import Array, Pairing, RegionPair
from zpm2.model import Polygon
from zpm2.runtime import StageTimer


class OutlineMethod(ABC):
    """What the shape methods share: `Method`, of a description of outlines and a comparison of two."""

    name: ClassVar[str]
    uses_points: ClassVar[bool] = False
    notes: ClassVar[tuple[str, ...]] = ()
    limit: float

    @abstractmethod
    def describe(self, polygons: Sequence[Polygon]) -> Counts:
        """(p, n, b) histograms of each polygon's n samples."""

    @abstractmethod
    def align(self, costs: Costs) -> Array:
        """(c,) distances 0..1 of c pairs from the (c, n, n) chi-square costs of their samples."""

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """The assignment with the least sum of distances; pairs as far apart as `limit` are left out."""
        with stage("describe"):
            shapes = self.describe(pair.polygons[0].polygons), self.describe(pair.polygons[1].polygons)
        with stage("compare"):
            distance = compare(*shapes, self.align, lambda share: stage.progress("compare", share))
            rows = one_to_one(distance, self.limit)
            cost = distance[rows[:, 0], rows[:, 1]]
        return Pairing(rows, cost, 1 - cost / self.limit)


def one_to_one(distance: Array, limit: float) -> NDArray[np.int64]:
    """(k, 2) rows and columns of a (p, q) matrix that are matched, each at most once: the optimal assignment.

    Its cost is the sum of the matched distances plus `limit` for each row or column of the smaller side that stays
    unmatched. A pair as far apart as `limit` is never matched.
    """
    rows, columns = linear_sum_assignment(np.minimum(distance, limit))
    pairs = np.c_[rows, columns].astype(np.int64)
    return np.asarray(pairs[distance[rows, columns] < limit])
