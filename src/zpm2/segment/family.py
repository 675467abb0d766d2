"""Families: bricks, windows, roof tiles. Once one element is found, the others are prompted for by its own shape.

The photograph around a region is correlated with all of the view (a local autocorrelation). Where it repeats, the point
and the box of the region become a prompt. A mask there belongs to the family if it has the region's size and shape. No
lattice is fitted: elements need not be evenly spaced, and one that is missing or hidden is not invented.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import FamilyConfig, SegmentConfig
from zpm2.cores import in_chunks
from zpm2.segment import automatic
from zpm2.segment.blobs import has_data
from zpm2.segment.predictions import (
    CORNER,
    INSIDE,
    OTHER_CORNER,
    MaskPredictions,
    MaskThresholds,
    Prompts,
)
from zpm2.segment.protocol import PromptedView
from zpm2.segment.stacks import boxes

FINE = 2  # px of the correlated photograph per px of a decoded mask
SEEDS = 4  # regions that are correlated at a time: no more, as one of them may be in another one's family


def with_families(
    view: PromptedView,
    predictions: MaskPredictions,
    config: SegmentConfig,
    thresholds: MaskThresholds,
    where: NDArray[np.bool_] | None = None,
    holding: NDArray[np.bool_] | None = None,
) -> MaskPredictions:
    """`predictions`, best first, and behind them further elements of their families that reach `thresholds`.

    `where` (height, width) of a decoded mask holds the prompts; None: all of the view. The box of an
    element has one of the pixels `holding`, of the same shape; None: any pixel.
    """
    valid = has_data(view.image, view.size)
    known = predictions.bits
    holding = np.ones(view.size, bool) if holding is None else holding
    places = _repetitions(view, known, config.family, valid if where is None else where & valid, holding)
    if not len(places.seed):
        return predictions
    found = view.predict(places.prompts(known, view.mask_scale), thresholds)
    rows = zip(found.prompt, found.bits, strict=True)
    fits = np.array([places.overlap(row, bits, known) for row, bits in rows], float)
    good = found[fits >= config.family.min_overlap]
    rank = np.arange(len(predictions) + len(good), 0.0, -1.0)
    return automatic.without_duplicates([predictions, good], rank, config, view)


@dataclass(frozen=True, eq=False)
class _Places:
    """Where n elements may be: each a region (row of the predictions) and how far it is moved, px of a decoded mask."""

    seed: NDArray[np.int64]  # (n,)
    shift: NDArray[np.int64]  # (n, 2) x, y

    def prompts(self, bits: NDArray[np.bool_], mask_scale: float) -> Prompts:
        """The innermost point and the box of each region, moved."""
        points = np.zeros((len(self.seed), 3, 2))
        for k, (seed, (x0, y0, x1, y1)) in enumerate(zip(self.seed, boxes(bits[self.seed]), strict=True)):
            depth = cv2.distanceTransform(np.pad(bits[seed, y0:y1, x0:x1], 1).view(np.uint8), cv2.DIST_L2, 5)
            y, x = np.unravel_index(np.argmax(np.rint(depth * 4)), depth.shape)
            points[k] = (x0 + x - 0.5, y0 + y - 0.5), (x0, y0), (x1, y1)
        size = np.array(bits.shape[:0:-1], float)
        return Prompts(
            np.clip(points + self.shift[:, None], 0, size) / mask_scale, np.array([INSIDE, CORNER, OTHER_CORNER])
        )

    def overlap(self, row: int, mask: NDArray[np.bool_], bits: NDArray[np.bool_]) -> float:
        """IoU of a mask with the moved region."""
        expected = _moved(bits[self.seed[row]], self.shift[row])
        return int((mask & expected).sum()) / max(int((mask | expected).sum()), 1)


def _repetitions(
    view: PromptedView,
    bits: NDArray[np.bool_],
    config: FamilyConfig,
    where: NDArray[np.bool_],
    holding: NDArray[np.bool_],
) -> _Places:
    """Where the regions (n, height, width) repeat, in their order, up to the budget. Places where a region of that size
    is known already, or whose box has none of the pixels `holding`, are left out."""
    height, width = view.size
    lab = cv2.cvtColor(
        cv2.resize(view.image.rgb, (FINE * width, FINE * height), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2LAB
    )
    known = _Known(bits)
    sides = known.box[:, 2:] - known.box[:, :2]
    seeds, shifts = [], []
    budget, tries = config.max_prompts, config.max_seeds
    rows = np.flatnonzero((sides.min(1) >= config.min_side) & (sides.max(1) <= config.max_side * max(view.size)))
    while len(rows := rows[~known.taken[rows]]) and tries > 0 and budget > 0:
        some, rows = np.split(rows, [min(SEEDS, tries)])
        for seed, at in zip(some, _peaks(lab, known.box[some], config), strict=True):
            if known.taken[seed] or budget <= 0:
                continue
            tries -= 1
            column, row = np.clip(at + known.box[seed, :2] + sides[seed] // 2, 0, [width - 1, height - 1]).T
            at = at[where[row, column]]
            if len(at) < config.min_members - 1:
                continue
            free = known.free(seed, at, holding, config.known_overlap)
            seeds += [seed] * len(free[:budget])
            shifts += free[:budget]
            budget -= len(free)
    return _Places(np.array(seeds, np.int64), np.array(shifts, np.int64).reshape(-1, 2))


class _Known:
    """The n regions that are known, in px of a decoded mask."""

    def __init__(self, bits: NDArray[np.bool_]) -> None:
        self.bits = bits  # (n, height, width)
        self.area: NDArray[np.int64] = bits.sum((1, 2))
        self.box = boxes(bits)  # (n, 4)
        self.taken = np.zeros(len(bits), bool)  # members of a family that another one has found

    def free(
        self, seed: int, shifts: NDArray[np.int64], holding: NDArray[np.bool_], overlap: float
    ) -> list[NDArray[np.int64]]:
        """Those of `shifts` (m, 2) where region `seed` would be new and its box has a pixel `holding`. The regions that
        it meets at the others are taken from now on."""
        free = []
        for shift in shifts:
            element = _moved(self.bits[seed], shift)
            if 2 * np.count_nonzero(element) < self.area[seed]:  # mostly outside of the view
                continue
            same = self._same(element, overlap)
            self.taken[same] = True
            x0, y0, x1, y1 = np.maximum(self.box[seed] + np.tile(shift, 2), 0)
            if not len(same) and holding[y0:y1, x0:x1].any():
                free.append(shift)
        return free

    def _same(self, mask: NDArray[np.bool_], overlap: float) -> NDArray[np.intp]:
        """Rows of the regions whose IoU with a mask (height, width) is at least `overlap`."""
        n = np.count_nonzero(mask)
        near = np.flatnonzero(np.minimum(self.area, n) >= overlap * np.maximum(self.area, n))
        shared = self.bits[near][:, mask].sum(1)
        return near[shared >= overlap * (self.area[near] + n - shared)]


def _peaks(lab: NDArray[np.uint8], box: NDArray[np.int64], config: FamilyConfig) -> list[NDArray[np.int64]]:
    """For each box (n, 4), px of a decoded mask: how far (m, 2), x, y, the photograph in it, with a margin, is found
    elsewhere, nearest first."""

    def found(one: slice) -> NDArray[np.int64]:
        (corners,) = box[one]
        margin = round(config.margin * FINE * int((corners[2:] - corners[:2]).min()))
        low = np.maximum(FINE * corners[:2] - margin, 0)
        high = np.minimum(FINE * corners[2:] + margin, lab.shape[1::-1])
        template = lab[low[1] : high[1], low[0] : high[0]]
        correlation = np.nan_to_num(cv2.matchTemplate(lab, template, cv2.TM_CCOEFF_NORMED), posinf=0.0, neginf=0.0)
        correlation = np.rint(correlation * 1000)  # OpenCV's last bits depend on where arrays lie in memory
        window = np.ones((template.shape[0] | 1, template.shape[1] | 1), np.uint8)
        peak = (correlation == cv2.dilate(correlation, window)) & (correlation >= 1000 * config.min_correlation)
        row, column = np.nonzero(peak)
        shift = np.rint((np.c_[column, row] - low) / FINE).astype(np.int64)
        distance = (shift**2).sum(1)
        order = np.argsort(distance, kind="stable")
        return np.asarray(shift[order[distance[order] > 0]])

    return in_chunks(found, len(box), 1)


def _moved(bits: NDArray[np.bool_], shift: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(height, width) a mask, moved by x, y and cut off at the borders."""
    (height, width), (x, y) = bits.shape, (int(v) for v in shift)
    result = np.zeros_like(bits)
    part = bits[max(0, -y) : height - max(0, y), max(0, -x) : width - max(0, x)]
    result[max(0, y) : max(0, y) + part.shape[0], max(0, x) : max(0, x) + part.shape[1]] = part
    return result
