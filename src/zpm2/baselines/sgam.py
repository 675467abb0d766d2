"""SGAM: Zhang et al., Searching from Area to Point (arXiv 2305.00194): semantic, then geometric area matching."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.baselines.method import Array, Checked, Pairing, RegionPair, Rows, Shapes, greedy
from zpm2.config.fields import number, share
from zpm2.errors import Failed
from zpm2.runtime import StageTimer


@dataclass(frozen=True)
class Sgam(Checked):
    """Regions that look alike, inside and around, are candidates; geometric consistency decides among them.

    Semantic area matching: a region is described by what it is and by what surrounds it. A pair whose similarity is
    the best of both regions, with no other within `doubt`, is certain; the others within `doubt` are doubtful.
    Geometric area matching: the predictor takes, among doubtful pairs, those whose inner point matches are the most
    consistent with one epipolar geometry; the rejector drops pairs whose inner matches are not.
    """

    name: ClassVar[str] = "sgam"
    uses_points: ClassVar[bool] = True
    notes: ClassVar[tuple[str, ...]] = (
        "sgam is our implementation of SGAM's area matching (Zhang et al., arXiv 2305.00194) on our regions: areas "
        "are described by SAM's encoder inside and around them, as there are no semantic labels; inner point matches "
        "are those of the whole images, as no area is matched again by itself; areas of intersection and the "
        "collection of points outside areas are left out",
    )
    min_similarity: float = share(0.3, "cosine of two descriptions, from which a pair is a candidate", source="ours")
    doubt: float = share(0.2, "cosine by which a candidate may be worse than the best", source="ours")
    surround: float = number(
        0.5, "width of the surroundings, of the side of a square of the same area", above=True, high=10, source="ours"
    )
    min_points: int = number(3, "inner point matches of a pair, at least", low=1, source="as `vote`")
    limit: float = number(
        5.0,
        "Sampson distance of a point that leaves the pair, the most of any",
        unit="px",
        above=True,
    )
    models: int = number(
        10, "pairs with the most inner matches whose geometry is tried", low=1, high=1000, source="ours, for speed"
    )
    ransac: float = number(1.0, "inlier threshold of each geometry", unit="px", above=True, source="released code")
    phi: float = number(
        10.0,
        "mean Sampson distance of a pair, in units of that within pairs, up to which it stays",
        above=True,
        source="the largest of the released alpha_list",
    )

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """Semantic area matching, then the predictor and the rejector."""
        sides = pair.polygons
        if not len(sides[0]) or not len(sides[1]):
            return Pairing.none()
        with stage("embed"):
            inside = pair.embed((sides[0].shapes, sides[1].shapes))
            around = pair.embed((self._around(sides[0].shapes), self._around(sides[1].shapes)))
        with stage("semantic"):
            similarity = (inside[0] @ inside[1].T + around[0] @ around[1].T) / 2
            rows, doubtful = candidates(similarity, self.min_similarity, self.doubt)
        with stage("geometric"):
            rows, inconsistency = self._consistent(pair, rows, doubtful)
        cost = inconsistency / self.limit
        return Pairing(rows, cost, 1 - cost)

    def _around(self, shapes: Shapes) -> Shapes:
        """The rings around the shapes."""
        wide = shapely.buffer(shapes, self.surround * np.sqrt(shapely.area(shapes)), quad_segs=4)
        return np.asarray(shapely.difference(wide, shapes), object)

    def _consistent(self, pair: RegionPair, rows: Rows, doubtful: NDArray[np.bool_]) -> tuple[Rows, Array]:
        """The pairs that predictor and rejector keep, and (k,) px how inconsistent each is."""
        inner = _inner_matches(pair, rows)
        enough = np.array([len(points) >= self.min_points for points in inner], bool)
        rows, doubtful = rows[enough], doubtful[enough]
        inner = [points for points, keep in zip(inner, enough, strict=True) if keep]
        distance, typical = self._sampson(pair, inner)
        own = np.array([distance[points].mean() for points in inner])
        count = np.array([len(points) for points in inner], np.int64)
        either = pair.shared.inside[0][rows[:, 0]] + pair.shared.inside[1][rows[:, 1]] - count
        leaving = (either - count) / np.maximum(either, 1)
        inconsistency = mixed(own, leaving, self.limit)
        predicted = greedy(rows, -inconsistency - np.where(doubtful, self.limit, 0.0))  # certain pairs first
        kept = predicted[own[predicted] <= self.phi * typical]
        return rows[kept], inconsistency[kept]

    def _sampson(self, pair: RegionPair, inner: list[NDArray[np.int64]]) -> tuple[Array, float]:
        """(n,) px distance of each homologous point to the best geometry, and the mean of the pairs it may come from.

        Each of the pairs with the most inner matches gives a fundamental matrix; the best one has the least mean
        distance to the inner matches of all. Without any, all distances are 0.
        """
        points = pair.points
        every = np.unique(np.concatenate([*inner, np.zeros(0, np.int64)])).astype(np.int64)
        best: tuple[float, Array] = (np.inf, np.zeros(len(points)))
        typical = []
        for k in sorted(range(len(inner)), key=lambda k: -len(inner[k]))[: self.models]:
            left, right = points.left[inner[k]], points.right[inner[k]]
            found = geometry.fundamental_matrix(left, right, self.ransac, pair.seed)
            if isinstance(found, Failed):
                continue
            all_distances = np.minimum(geometry.sampson_distance(found[0], points.left, points.right), self.limit)
            typical.append(float(all_distances[inner[k]].mean()))
            mean = float(all_distances[every].mean())
            best = min(best, (mean, all_distances), key=lambda each: each[0])
        return best[1], float(np.mean(typical)) if typical else np.inf


def candidates(similarity: Array, least: float, doubt: float) -> tuple[Rows, NDArray[np.bool_]]:
    """(p, 2) pairs of an (m, n) similarity that are the best of both of their regions, or worse by `doubt` at most; and
    (p,) whether there is another such pair for one of them."""
    near = similarity >= np.maximum(least, similarity.max(axis=1, keepdims=True) - doubt)
    near &= similarity >= similarity.max(axis=0, keepdims=True) - doubt
    rows = np.argwhere(near).astype(np.int64)
    several = (near.sum(axis=1) > 1)[rows[:, 0]] | (near.sum(axis=0) > 1)[rows[:, 1]]
    return rows, several


def mixed(own: Array, leaving: Array, limit: float) -> Array:
    """(k,) px, 0..`limit`: the mean distance of a pair's points where those that leave it, a share, count `limit`."""
    return np.asarray(limit - (1 - leaving) * (limit - np.minimum(own, limit)))  # rounding never exceeds the limit


def _inner_matches(pair: RegionPair, rows: Rows) -> list[NDArray[np.int64]]:
    """The rows of the homologous points inside both regions of each pair."""
    shared = pair.shared
    known = zip(shared.pairs.left.tolist(), shared.pairs.right.tolist(), strict=True)
    at = {key: k for k, key in enumerate(known)}
    none = np.zeros(0, np.int64)
    found = (at.get((int(i), int(j))) for i, j in rows)
    return [none if k is None else shared.point[shared.start[k] : shared.start[k + 1]] for k in found]
