"""Point voting: what one would write in an afternoon."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from zpm2.baselines.method import Checked, Pairing, RegionPair, Rows, mutual_best
from zpm2.config.fields import number
from zpm2.runtime import StageTimer


@dataclass(frozen=True)
class Vote(Checked):
    """Two regions match if they are each other's best by their shared homologous points.

    The score is the IoU of the points: those inside both regions / those inside either. Nothing else is looked at: no
    outline, no texture, no geometry, no neighbour.
    """

    name: ClassVar[str] = "vote"
    uses_points: ClassVar[bool] = True
    notes: ClassVar[tuple[str, ...]] = ("vote is a plain vote of homologous points, of no publication",)
    min_points: int = number(3, "points inside both regions, at least", low=1, source="fewer are often chance")

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """Mutual best by the IoU of the points."""
        with stage("vote"):
            shared = pair.shared
            enough = shared.counts >= self.min_points
            pairs: Rows = np.c_[shared.pairs.left, shared.pairs.right][enough]
            both = shared.counts[enough]
            either = shared.inside[0][pairs[:, 0]] + shared.inside[1][pairs[:, 1]] - both
            score = both / np.maximum(either, 1)
            best = mutual_best(pairs, score)
        return Pairing(pairs[best], 1 - score[best], score[best])
