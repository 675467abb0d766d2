"""Several point matchers as one: their matches together, without duplicates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.features.answers import points_of, points_of_many
from zpm2.features.protocol import PointMatcher
from zpm2.model import Image, PointMatches
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.runtime import check_not_forked


@dataclass(frozen=True, eq=False)
class CombinedMatcher:
    """The matches of one or several matchers that score at least `min_score`, without duplicates (`distinct`).

    The scores of different methods have no common scale beyond 0..1: they are passed on as they are.
    """

    matchers: Sequence[PointMatcher]
    min_score: float  # 0..1
    merge_px: float  # matches that are closer in both images are one

    @property
    def name(self) -> str:
        """See `PointMatcher.name`."""
        return "+".join(m.name for m in self.matchers)

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`. Ordered by method, then as the method gives them."""
        return self.match_kept(left, right, NOTHING_KEPT)

    def match_kept(self, left: Image, right: Image, kept: KeptPhotos) -> PointMatches:
        """The same, with the features of photographs that are `kept`, of matchers that look at each one alone."""
        check_not_forked()
        return self._joined([points_of(m, left, right, kept) for m in self.matchers])

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`."""
        check_not_forked()
        return [self._joined(found) for found in zip(*(points_of_many(m, pairs) for m in self.matchers), strict=True)]

    def _joined(self, found: Sequence[PointMatches]) -> PointMatches:
        joined = PointMatches.join(found)
        joined = joined[joined.score >= self.min_score]
        return joined[distinct(joined, self.merge_px)]


def distinct(matches: PointMatches, radius: float) -> NDArray[np.bool_]:
    """(n,) which matches to keep so that no two lie within `radius` px of each other in both images.

    Of two such matches the better score stays (at equal scores the earlier one): non-maximum suppression by descending
    score, in rounds. A match stays if no better one that is still undecided is close to it; what is close to it goes.
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
