"""Shape Context: Belongie, Malik and Puzicha, Shape Matching and Object Recognition Using Shape Contexts, PAMI 2002."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from zpm2.baselines.contour import outline, sample, tangents
from zpm2.baselines.histograms import Costs, Counts, check_bins, log_polar
from zpm2.baselines.outlines import OutlineMethod
from zpm2.model import Polygon


@dataclass(frozen=True)
class ShapeContext(OutlineMethod):
    """Outlines as log-polar histograms of their samples; distance = mean chi-square cost of the best assignment.

    Invariant to translation and scale; to rotation only with `rotated`, where angles count from the outline's tangent.
    The publication's thin-plate warp and appearance terms are left out: the paper compares descriptors.
    """

    name: ClassVar[str] = "shape-context"
    samples: int = 100  # along each outline
    rings: int = 5  # log of the distance
    sectors: int = 12  # angle
    rotated: bool = False  # whether angles are measured from the tangent instead of the image's x axis
    limit: float = 0.14  # 0..1, distance from which a pair stays unmatched; best F1 on real pairs (docs/baselines.md)

    def __post_init__(self) -> None:
        check_bins(self.samples, self.rings, self.sectors, self.limit)

    def describe(self, polygons: Sequence[Polygon]) -> Counts:
        """(p, n, rings * sectors) histograms of each polygon's n samples."""
        counts = np.zeros((len(polygons), self.samples, self.rings * self.sectors), np.uint16)
        for k, polygon in enumerate(polygons):
            points = sample(outline(polygon.exterior), self.samples)
            away = points[None] - points[:, None]
            angle = np.arctan2(away[..., 1], away[..., 0])
            frame = tangents(points)[:, None] if self.rotated else 0.0
            counts[k] = log_polar(np.hypot(away[..., 0], away[..., 1]), angle - frame, self.rings, self.sectors)
        return counts

    def align(self, costs: Costs) -> NDArray[np.float64]:
        """(c,) distances 0..1 of c pairs from the (c, n, n) costs of their samples."""
        return np.array([cost[linear_sum_assignment(cost)].mean(dtype=np.float64) for cost in costs])
