"""MASA's association: Li et al., Matching Anything by Segmenting Anything, CVPR 2024.

The left image is the first frame of a track, the right one the second.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import softmax

from zpm2.baselines.method import Array, Checked, Pairing, RegionPair, Rows
from zpm2.config.fields import number, share
from zpm2.runtime import StageTimer


@dataclass(frozen=True)
class Masa(Checked):
    """Regions match by the mean of the bi-softmax and the cosine of their embeddings, the best segmented ones first.

    As in the released tracker: score = ((softmax over the left + softmax over the right) / 2 + cosine) / 2; each right
    region, in the order of its segmentation score, takes its best left one, if that is free and reaches `min_score`.
    """

    name: ClassVar[str] = "masa"
    uses_points: ClassVar[bool] = False
    notes: ClassVar[tuple[str, ...]] = (
        "masa is our implementation of MASA's association (Li et al., CVPR 2024) on our regions: embeddings are SAM's "
        "encoder averaged over the region, without MASA's trained adapter, its detector and its rules for video",
    )
    min_score: float = share(0.5, "score from which two regions match", source="released tracker, match_score_thr")
    temperature: float = number(
        0.07, "divides cosines before the softmax", above=True, high=100, source="stands for the norm that MASA trains"
    )

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """The association of the right regions with the left ones."""
        sides = pair.polygons
        if not len(sides[0]) or not len(sides[1]):
            return Pairing.none()
        with stage("embed"):
            left, right = pair.embed((sides[0].shapes, sides[1].shapes))
        with stage("associate"):
            score = association(left, right, self.temperature)
            order = np.argsort([-polygon.score for polygon in sides[1].polygons], kind="stable")
            rows = take_in_turn(score, order, self.min_score)
        found = np.clip(score[rows[:, 0], rows[:, 1]], 0, 1)
        return Pairing(rows, 1 - found, found)


def association(left: Array, right: Array, temperature: float) -> Array:
    """(m, n) scores of m left and n right regions from their (m, c) and (n, c) embeddings of length 1."""
    cosine = left @ right.T
    logits = cosine / temperature
    both = (softmax(logits, axis=0) + softmax(logits, axis=1)) / 2
    return np.asarray((both + cosine) / 2)


def take_in_turn(score: Array, order: np.ndarray, least: float) -> Rows:
    """(k, 2) pairs: each column of the (m, n) scores, in the given order, takes the best row that is free, if the score
    is above `least`."""
    free = np.ones(len(score), bool)
    rows = []
    for j in order.tolist():
        column = np.where(free, score[:, j], -np.inf)
        i = int(column.argmax())
        if column[i] > least:
            free[i] = False
            rows.append((i, j))
    return np.array(sorted(rows), np.int64).reshape(-1, 2)
