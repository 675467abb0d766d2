"""Scores the polygon matches of a rectified pair against its dense disparity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.evaluate.ground_truth import from_disparity, overlap
from zpm2.evaluate.metrics import match_rows, score_overlap
from zpm2.model import Polygon, PolygonMatch


@dataclass(frozen=True)
class DisparityScore:
    """How many of the matches that can be judged are good, and the area that these cover."""

    good: int  # matches whose polygons overlap by at least the IoU asked for
    scored: int  # matches with enough co-visible pixels
    precision: float  # good / scored, 0..1; 0 where nothing could be scored
    coverage: float  # 0..1, share of the co-visible pixels that lie inside both polygons of a good match


def score_on_disparity(
    left_polygons: Sequence[Polygon],
    right_polygons: Sequence[Polygon],
    matches: Sequence[PolygonMatch],
    disparity: NDArray[np.floating],
    iou: float = 0.5,
) -> DisparityScore:
    """Score each match by the IoU of its two polygons, over the pixels that both images see.

    disparity: (h, w) px of the left image, x_right = x_left - d, not finite where unknown; the right image has the same
    size. `evaluate.ground_truth` defines what both images see and which matches can be judged. `InputError` where a
    match names a polygon that is not there, or two matches name the same one.
    """
    rows = match_rows(left_polygons, right_polygons, matches)
    size = disparity.shape[1], disparity.shape[0]
    overlaps = overlap(left_polygons, right_polygons, from_disparity(disparity, size), size, size)
    found = score_overlap(overlaps, rows, iou)
    return DisparityScore(found.good, found.scored, found.P, found.CCR)
