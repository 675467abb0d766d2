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
    photograph = _Photograph.of(cv2.resize(view.image.rgb, (FINE * width, FINE * height), interpolation=cv2.INTER_AREA))
    known = _Known(bits)
    sides = known.box[:, 2:] - known.box[:, :2]
    seeds, shifts = [], []
    budget, tries = config.max_prompts, config.max_seeds
    rows = np.flatnonzero((sides.min(1) >= config.min_side) & (sides.max(1) <= config.max_side * max(view.size)))
    while len(rows := rows[~known.taken[rows]]) and tries > 0 and budget > 0:
        some, rows = np.split(rows, [min(SEEDS, tries)])
        for seed, at in zip(some, _peaks(photograph, known.box[some], config), strict=True):
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
        for x, y in shifts:
            x0, y0, x1, y1 = np.clip(self.box[seed] + [x, y, x, y], 0, self.bits.shape[:0:-1] * 2)
            element = self.bits[seed, y0 - y : y1 - y, x0 - x : x1 - x]
            if 2 * np.count_nonzero(element) < self.area[seed]:  # mostly outside of the view
                continue
            same = self._same(element, np.s_[y0:y1, x0:x1], overlap)
            self.taken[same] = True
            if not len(same) and holding[y0:y1, x0:x1].any():
                free.append(np.array([x, y]))
        return free

    def _same(self, element: NDArray[np.bool_], there: tuple[slice, slice], overlap: float) -> NDArray[np.intp]:
        """Rows of the regions whose IoU with the `element`, whose pixels are these, is at least `overlap`."""
        n = np.count_nonzero(element)
        near = np.flatnonzero(np.minimum(self.area, n) >= overlap * np.maximum(self.area, n))
        shared = (self.bits[near, *there] & element).sum((1, 2))
        return near[shared >= overlap * (self.area[near] + n - shared)]


@dataclass(frozen=True, eq=False)
class _Photograph:
    """A photograph (h, w) whose parts are correlated with all of it, in Lab."""

    channels: list[NDArray[np.uint8]]  # three (h, w)
    sums: list[NDArray[np.float64]]  # (h + 1, w + 1) of each, over all rows and columns before
    squares: NDArray[np.float64]  # (h + 1, w + 1) of all three together

    @staticmethod
    def of(rgb: NDArray[np.uint8]) -> "_Photograph":
        lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)
        sums, squares = cv2.integral2(lab)
        return _Photograph(list(cv2.split(lab)), [each.astype(float) for each in cv2.split(sums)], squares.sum(2))

    @property
    def size(self) -> NDArray[np.int64]:
        """(2,) width and height."""
        return np.array(self.channels[0].shape[::-1])

    def correlation(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray[np.float64]:
        """(h - y1 + y0 + 1, w - x1 + x0 + 1) normalised correlation coefficient, -1..1, of the part from `low` (x0, y0)
        to `high` (x1, y1) with that from each place on; 0 where either has no contrast."""
        (x, y), (w, h) = low, high - low
        parts = (each[y : y + h, x : x + w] for each in self.channels)
        # one channel at a time: several take OpenCV more than twice as long
        covariance = sum(
            cv2.matchTemplate(each, part, cv2.TM_CCOEFF) for each, part in zip(self.channels, parts, strict=True)
        )
        variance = _windows(self.squares, w, h)
        for each in self.sums:
            variance -= _windows(each, w, h) ** 2 / (w * h)
        both = np.sqrt(np.maximum(variance * variance[y, x], 0))
        return np.divide(covariance, both, out=np.zeros_like(both), where=both >= 1)  # grey values are whole numbers


def _windows(integral: NDArray[np.float64], width: int, height: int) -> NDArray[np.float64]:
    """The sums over all windows of a size, of what `integral` sums up."""
    lines = integral[height:] - integral[:-height]
    return np.asarray(lines[:, width:] - lines[:, :-width])


def _peaks(photograph: _Photograph, box: NDArray[np.int64], config: FamilyConfig) -> list[NDArray[np.int64]]:
    """For each box (n, 4), px of a decoded mask: how far (m, 2), x, y, the photograph in it, with a margin, is found
    elsewhere, nearest first."""

    def found(one: slice) -> NDArray[np.int64]:
        (corners,) = box[one]
        margin = round(config.margin * FINE * int((corners[2:] - corners[:2]).min()))
        low = np.maximum(FINE * corners[:2] - margin, 0)
        high = np.minimum(FINE * corners[2:] + margin, photograph.size)
        # OpenCV's last bits depend on where arrays lie in memory
        correlation = np.rint(photograph.correlation(low, high) * 1000).astype(np.float32)
        window = np.ones((high - low)[::-1] | 1, np.uint8)
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
