"""What guided re-detection tells the matcher: where the left polygons should be, and which polygons are uncertain."""

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import DetailConfig, GuidedConfig
from zpm2.global_match import Candidates
from zpm2.model import PolygonArrays
from zpm2.polygons.warp import WarpedPolygons


@dataclass(frozen=True, eq=False)
class GuidedPrior:
    """What is known about m left and n right polygons before they are matched."""

    warped: WarpedPolygons  # the left ones in the right image
    confident: tuple[NDArray[np.bool_], NDArray[np.bool_]]  # (m,), (n,) passed `segment`'s thresholds
    guided: tuple[NDArray[np.bool_], NDArray[np.bool_]]  # (m,), (n,) found by prompting with the other image's
    config: GuidedConfig
    closer: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None  # (m,), (n,) found by a closer look
    detail: DetailConfig = field(default_factory=DetailConfig)

    def candidates(self, known: Candidates, right: PolygonArrays) -> Candidates:
        """`known`, and each right polygon that a warped left one touches."""
        i, j = shapely.STRtree(right.shapes).query(self.warped.shapes, predicate="intersects")
        return Candidates.of(np.append(known.left, i), np.append(known.right, j))

    def least_overlap(
        self, pairs: Candidates, agreement: NDArray[np.float64], dsf: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """(c,) the overlap (IoU) from which a pair may match; infinite for one that never may.

        Both polygons are confident, or the overlap and the `agreement` of its points (`CandidateScores`) are high
        enough. What a closer look found must fit better, and share points.
        """
        config, detail = self.config, self.detail
        confident = self.confident[0][pairs.left] & self.confident[1][pairs.right]
        agreeing = np.where(agreement >= config.min_agreement, config.min_match_overlap, np.inf)
        least = np.where(confident, 0.0, agreeing)
        if self.closer is None:
            return least
        closer = self.closer[0][pairs.left] | self.closer[1][pairs.right]
        fits = np.where(dsf >= detail.min_points, detail.min_overlap, np.inf)
        return np.where(closer, np.maximum(least, fits), least)

    def is_guided(self, pairs: Candidates) -> NDArray[np.bool_]:
        """(c,) whether one of a pair's polygons was found by prompting with the other image's."""
        return np.asarray(self.guided[0][pairs.left] | self.guided[1][pairs.right])
