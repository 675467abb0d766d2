"""How many polygon matches of a rectified pair are right, counted on its dense disparity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Polygon, PolygonMatch

MIN_POINTS = 20  # co-visible pixels in either polygon, below which a match cannot be judged
MIN_SHARE = 0.02  # of the larger polygon's pixels, likewise


@dataclass(frozen=True)
class Score:
    """Counts over the matches that can be judged, and the area that the good ones explain."""

    good: int  # matches whose polygons overlap by at least the IoU asked for
    scored: int  # matches with enough co-visible pixels
    precision: float  # good / scored, 0..1; 0 where nothing could be scored
    coverage: float  # 0..1, share of the co-visible pixels that lie inside both polygons of a good match


def score(
    left_polygons: Sequence[Polygon],
    right_polygons: Sequence[Polygon],
    matches: Sequence[PolygonMatch],
    disparity: NDArray[np.floating[Any]],
    iou: float = 0.5,
) -> Score:
    """Judges each match by the IoU of its two polygons over the pixels that both images see.

    disparity: (h, w) px of the left image, x_right = x_left - d, not finite where unknown; the right image has the same
    size. Left pixels that leave the right image, or that a nearer one hides there (by more than 1 px of disparity, on a
    z-buffer of whole pixels), do not count. A match with under 20 such pixels in either polygon, or under 2 % of the
    larger polygon's pixels, is not scored. `InputError` where a match names a polygon that is not there.
    """
    rows, columns, hits = _covisible(disparity)
    by_id = {p.id: p for p in left_polygons}, {p.id: p for p in right_polygons}
    good = scored = 0
    explained = np.zeros(len(rows), bool)
    for match in matches:
        if match.left not in by_id[0] or match.right not in by_id[1]:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
        first = _pixels(by_id[0][match.left], disparity.shape)
        second = _pixels(by_id[1][match.right], disparity.shape)
        in_left, in_right = first[rows, columns], second[rows, hits]
        both, either = in_left & in_right, np.count_nonzero(in_left | in_right)
        if either < max(MIN_POINTS, MIN_SHARE * max(np.count_nonzero(first), np.count_nonzero(second))):
            continue
        scored += 1
        if np.count_nonzero(both) >= iou * either:
            good += 1
            explained |= both
    coverage = float(explained.mean()) if len(explained) else 0.0
    return Score(good, scored, good / scored if scored else 0.0, coverage)


def _covisible(disparity: NDArray[np.floating[Any]]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of each left pixel that the right image sees too, and its column there."""
    rows, columns = np.nonzero(np.isfinite(disparity))
    d = disparity[rows, columns].astype(np.float64)
    hits = np.floor(columns + 0.5 - d).astype(np.intp)
    inside = (hits >= 0) & (hits < disparity.shape[1])
    rows, columns, hits, d = rows[inside], columns[inside], hits[inside], d[inside]
    nearest = np.full(disparity.shape, -np.inf)
    np.maximum.at(nearest, (rows, hits), d)
    seen = d >= nearest[rows, hits] - 1
    return rows[seen], columns[seen], hits[seen]


def _pixels(polygon: Polygon, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """(h, w) the pixels of a polygon, holes left out."""
    mask = np.zeros(shape, np.uint8)
    for value, rings in ((1, [polygon.exterior]), (0, polygon.holes)):
        for ring in rings:
            cv2.fillPoly(mask, [np.rint((ring - 0.5) * 16).astype(np.int32)], value, shift=4)
    return mask.astype(bool)
