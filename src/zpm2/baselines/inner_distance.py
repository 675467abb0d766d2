"""Inner-Distance Shape Context: Ling and Jacobs, Shape Classification Using the Inner-Distance, PAMI 2007."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path

from zpm2.baselines.contour import outline, sample, tangents
from zpm2.baselines.histograms import Costs, Counts, check_bins, log_polar
from zpm2.baselines.outlines import OutlineMethod
from zpm2.errors import ConfigError
from zpm2.model import Polygon

Array = NDArray[np.float64]
INSIDE_TOLERANCE = 1e-6  # of the outline's length, by which a segment may leave the polygon: rounding
PAIRS_AT_ONCE = 64  # aligned together, so that their costs fit into the processor's cache


@dataclass(frozen=True)
class InnerDistance(OutlineMethod):
    """Outlines as log-polar histograms of inner distances and inner angles; distance = mean cost along the outlines.

    Samples are matched in their order along both outlines by dynamic programming, from `starts` places of the second
    outline, of which the best one counts; a sample may stay unmatched at the price `penalty`. Invariant to
    translation, scale and rotation, and nearly to bending at joints.
    """

    name: ClassVar[str] = "idsc"
    samples: int = 100  # along each outline
    rings: int = 5  # log of the inner distance
    sectors: int = 12  # inner angle
    penalty: float = 0.3  # tau, cost of a sample that is occluded
    starts: int = 8  # k, places where the second outline may start
    limit: float = 0.12  # 0..1, distance from which a pair stays unmatched; best F1 on real pairs (docs/baselines.md)

    def __post_init__(self) -> None:
        check_bins(self.samples, self.rings, self.sectors, self.limit)
        if not 0 < self.penalty <= 1 or not 1 <= self.starts <= self.samples:
            raise ConfigError(
                "the occlusion penalty must lie in (0, 1] and starts from 1 to the number of samples, "
                f"got {self.penalty} and {self.starts}"
            )

    def describe(self, polygons: Sequence[Polygon]) -> Counts:
        """(p, n, rings * sectors) histograms of each polygon's n samples."""
        counts = np.zeros((len(polygons), self.samples, self.rings * self.sectors), np.uint16)
        for k, polygon in enumerate(polygons):
            ring = outline(polygon.exterior)
            points = sample(ring, self.samples)
            distance, angle = inner_paths(ring, points)
            counts[k] = log_polar(distance, angle - tangents(points)[:, None], self.rings, self.sectors)
        return counts

    def align(self, costs: Costs) -> Array:
        """(c,) distances 0..penalty of c pairs from the (c, n, n) costs of their samples."""
        parts = [costs[at : at + PAIRS_AT_ONCE] for at in range(0, len(costs), PAIRS_AT_ONCE)]
        return np.concatenate([align_ordered(part, self.penalty, self.starts) for part in parts])


def inner_paths(ring: Array, points: Array) -> tuple[Array, Array]:
    """(n, n) length of the shortest path inside the polygon from point to point, and the angle at which it leaves.

    Points are (n, 2) samples of the (v, 2) ring in order and in the frame of `contour.outline`; angles are radians
    from the x axis. As published, paths run from sample to sample: two are joined where the segment between them lies
    in the polygon, and neighbours always. So paths bend at the sample nearest to a concave corner, and are a little
    longer than the shortest. Holes are no obstacle.
    """
    n = len(points)
    i, j = np.triu_indices(n, 1)
    region = shapely.Polygon(ring).buffer(INSIDE_TOLERANCE, join_style="mitre")
    shapely.prepare(region)
    seen = shapely.covers(region, shapely.linestrings(np.stack([points[i], points[j]], axis=1)))
    seen |= (j - i == 1) | (j - i == n - 1)
    graph = np.full((n, n), np.inf)
    length = np.hypot(*(points[j] - points[i]).T)
    graph[i, j] = np.where(seen, np.maximum(length, 1e-12), np.inf)  # an edge of length 0 would count as none
    distance, before = shortest_path(graph, method="FW", directed=False, return_predecessors=True)
    after = np.where(np.eye(n, dtype=bool), np.arange(n), before.T)  # the way from i to j begins as that back ends
    away = points[after] - points[:, None]
    return distance, np.arctan2(away[..., 1], away[..., 0])


def align_ordered(costs: Costs, penalty: float, starts: int) -> Array:
    """(c,) least mean cost of matching n samples to m in their order, from the best of `starts` cyclic shifts of the m.

    Costs are (c, n, m). Each of the n samples goes to one of the m, later ones to later ones, or costs `penalty`;
    samples of the m that stay free cost nothing.
    """
    c, n, m = costs.shape
    shifts = np.arange(starts) * m // starts
    twice = np.concatenate([costs, costs], axis=2)
    best = np.zeros((c, len(shifts), m + 1), np.float32)  # least cost so far using the first 0, 1, ... m samples
    for i in range(n):
        row = np.stack([twice[:, i, s : s + m] for s in shifts], axis=1)
        matched = best[..., :-1] + row
        best += np.float32(penalty)
        np.minimum(best[..., 1:], matched, out=best[..., 1:])
        np.minimum.accumulate(best, axis=2, out=best)
    return np.asarray(best[..., -1].min(axis=1).astype(np.float64) / n)
