"""Several point matchers as one: their matches together, without those that say the same thing twice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.features.protocol import PointMatcher
from zpm2.model import Image, PointMatches
from zpm2.runtime import check_not_forked

SAME_PX = 1.0  # px, in both images: two matches that are closer are one


@dataclass(frozen=True, eq=False)
class Combined:
    """The matches of one or several matchers that score at least `min_score`, each said once (`distinct`).

    The scores of different methods have no common scale beyond 0..1: they are passed on as they are.
    """

    matchers: Sequence[PointMatcher]
    min_score: float  # 0..1

    @property
    def name(self) -> str:
        return "+".join(m.name for m in self.matchers)

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`. Ordered by method, then as the method gives them."""
        check_not_forked()
        return self._together([m.match(left, right) for m in self.matchers])

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`."""
        check_not_forked()
        return [self._together(found) for found in zip(*(m.match_many(pairs) for m in self.matchers), strict=True)]

    def _together(self, found: Sequence[PointMatches]) -> PointMatches:
        together = PointMatches.join(found)
        together = together[together.score >= self.min_score]
        return together[distinct(together, SAME_PX)]


def distinct(matches: PointMatches, radius: float) -> NDArray[np.bool_]:
    """(n,) which matches to keep so that no two lie within `radius` px of each other in both images.

    Of two such matches the better score stays (at equal scores the earlier one): non-maximum suppression by descending
    score, done in rounds. A match that no undecided better one is close to stays; what is close to it goes.
    """
    n = len(matches)
    rank = np.empty(n, np.intp)
    rank[np.argsort(-matches.score, kind="stable")] = np.arange(n)
    close = cKDTree(np.c_[matches.left, matches.right]).query_pairs(radius, p=np.inf, output_type="ndarray")
    near = [((p[close[:, 0]] - p[close[:, 1]]) ** 2).sum(1) <= radius**2 for p in (matches.left, matches.right)]
    close = close[near[0] & near[1]]
    first = rank[close[:, 0]] < rank[close[:, 1]]
    better, worse = np.where(first, close[:, 0], close[:, 1]), np.where(first, close[:, 1], close[:, 0])
    gone = np.zeros(n, bool)
    while len(better):
        beaten = np.zeros(n, bool)
        beaten[worse] = True
        gone[worse[~beaten[better]]] = True
        open_ = beaten[better] & ~gone[better] & ~gone[worse]
        better, worse = better[open_], worse[open_]
    return ~gone
