"""Segment everything: which prompts to ask, and which of the answers are regions of their own.

With every point of the grid asked, this is SAM's automatic mask generator (Kirillov et al. 2023, Appendix B, "Automatic
Mask Generation") on one view of the image. Most of these points ask about one region again: on an aerial photograph
1024 of them bring two dozen regions. The faster levels of quality ask a few points of the grid, for what is large; then
where the photograph differs from its surroundings (`blobs`), most different first, unless a mask of about that size
is there already; then points of the grid outside of the finest mask of every prompt, in an order of which any first
part is spread over the image. Whole, part and subpart come with every prompt. A level of quality is how many are asked.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.segment import suppression
from zpm2.segment.blobs import blobs, has_data
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView

FIRST = 1 / 64  # of the points of the grid: asked before anything else
BLOBS = {"fast": 1 / 6, "balanced": 1 / 3}  # places that stand out, in number of points of the grid
OUTSIDE = {"fast": 1 / 4, "balanced": 1 / 2}  # of the points of the grid, where nothing was found
EXPLAINED = 6.0  # areas of a blob: a mask there that is not larger is what stands out
CHUNK = 256  # masks looked at at a time; one takes up to 64 kB
Rows = NDArray[np.int64]


def automatic_masks(
    view: PromptedView,
    config: SegmentConfig,
    thresholds: MaskThresholds | None = None,
    known: MaskPredictions | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> MaskPredictions:
    """The regions of a view that the prompts find, best score first, `known` ones before all others.

    `thresholds` are `config`'s, if no others are given. `known` are masks that are regions already, the best one first:
    where they are fine no prompt is made, and a mask that overlaps one of them by more than `config.nms_iou` is the
    same region.
    """
    thresholds = thresholds or MaskThresholds(config.min_predicted_iou, config.min_stability)
    known = MaskPredictions.none(view.size) if known is None else known
    if config.quality == "full":
        found, points = [], grid(config.grid, view.size)
        points = points[has_data(view.image, view.size)[_pixels(points)]]
        for start in range(0, len(points), view.batch):
            found.append(view.predict(Prompts.at(points[start : start + view.batch] / view.mask_scale), thresholds))
            progress(min(1.0, (start + view.batch) / len(points)))
    else:
        found = _where_it_pays(view, config, thresholds, known, progress)
    predictions = MaskPredictions.join([known, *found])
    del found
    rank = predictions.score.astype(np.float64)
    rank[: len(known)] = 2.0 + np.arange(len(known), 0.0, -1.0)
    return distinct(predictions, rank, config, view)


def _where_it_pays(
    view: PromptedView,
    config: SegmentConfig,
    thresholds: MaskThresholds,
    known: MaskPredictions,
    progress: Callable[[float], None],
) -> list[MaskPredictions]:
    """The answers to the prompts of the faster levels, batch by batch."""
    points, valid, seen = grid(config.grid, view.size), has_data(view.image, view.size), _Seen(view.size)
    spots = blobs(view.image, valid)
    seen.add(known.bits, known.bits)
    seen.covered |= ~valid
    first, most_spots, outside = (
        max(1, round(share * len(points))) for share in (FIRST, BLOBS[config.quality], OUTSIDE[config.quality])
    )
    found: list[MaskPredictions] = []

    def predict(at: NDArray[np.float64], worth: Callable[[Rows], NDArray[np.bool_]], most: int, done: int) -> None:
        """At most so many of the points, in their order, that are worth it when their turn comes."""
        rows, asked = np.arange(len(at)), 0
        while asked < most and len(rows := rows[worth(rows)]):
            some, rows = np.split(rows, [min(view.batch, most - asked)])
            predictions = view.predict(Prompts.at(at[some] / view.mask_scale), thresholds)
            seen.add(predictions.bits, _finest_around(predictions, *_pixels(at[some])).bits)
            found.append(predictions)
            asked += len(some)
            progress((done + asked) / (first + most_spots + outside))

    def unexplained(rows: Rows) -> NDArray[np.bool_]:
        return np.asarray(seen.smallest[_pixels(spots.points[rows])] > EXPLAINED * spots.area[rows])

    predict(points[:first], lambda rows: ~seen.covered[_pixels(points[rows])], first, 0)
    predict(spots.points, unexplained, most_spots, first)
    rest = points[first:]
    predict(rest, lambda rows: ~seen.covered[_pixels(rest[rows])], outside, first + most_spots)
    progress(1.0)
    return found


class _Seen:
    """What the answers so far show."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.covered: NDArray[np.bool_] = np.zeros(size, bool)  # by the finest mask of a prompt, or without data
        self.smallest: NDArray[np.float64] = np.full(size, np.inf)  # px^2, of the masks that a pixel lies in

    def add(self, masks: NDArray[np.bool_], finest: NDArray[np.bool_]) -> None:
        """Masks (n, h, w), and those of them that are the finest of a prompt."""
        self.covered |= finest.any(0)
        for bits in masks:
            self.smallest[bits] = np.minimum(self.smallest[bits], np.count_nonzero(bits))


def _pixels(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of (n, 2) points."""
    column, row = points.astype(np.int64).T
    return row, column


def grid(n: int, size: tuple[int, int]) -> NDArray[np.float64]:
    """(n * n, 2) x, y: the centres of n x n cells of a (height, width), in an order of which each first part is spread
    evenly: every second cell of a chessboard, of these every second row, and so on down to two cells."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    rank = np.zeros(x.shape, np.int64)
    for k in range((n - 1).bit_length()):  # the lowest bits weigh most
        rank = (rank << 2) | (((x >> k) ^ (y >> k)) & 1) << 1 | ((y >> k) & 1)
    order = np.argsort(rank.ravel(), kind="stable")
    return np.c_[(x.ravel()[order] + 0.5) * size[1] / n, (y.ravel()[order] + 0.5) * size[0] / n]


def distinct(
    predictions: MaskPredictions, rank: NDArray[np.floating], config: SegmentConfig, view: PromptedView
) -> MaskPredictions:
    """Without masks that are too small or too large, and of those that show the same region the one of highest `rank`
    (n,); highest rank first."""
    area = np.array([np.count_nonzero(logits > 0) for logits in predictions.logits], np.int64)
    pixels = area / view.mask_scale**2  # image px^2
    usable = (pixels >= config.min_area / 2) & (area > 0)
    usable &= pixels <= config.max_area * view.image.width * view.image.height
    rows = np.flatnonzero(usable)
    if len(rows) == 0:
        return predictions[rows]
    chunks = (predictions.logits[rows[k : k + CHUNK]] > 0 for k in range(0, len(rows), CHUNK))
    packed, box = map(
        np.concatenate, zip(*((suppression.pack(bits), suppression.boxes(bits)) for bits in chunks), strict=True)
    )
    return predictions[rows[suppression.suppress(packed, box, area[rows], rank[rows], config.nms_iou)]]


def _finest_around(predictions: MaskPredictions, row: NDArray[np.int64], column: NDArray[np.int64]) -> MaskPredictions:
    """Of each prompt the smallest mask that contains its own point."""
    bits = predictions.bits
    around = np.flatnonzero(bits[np.arange(len(bits)), row[predictions.prompt], column[predictions.prompt]])
    area = bits[around].sum((1, 2))
    order = around[np.lexsort((area, predictions.prompt[around]))]
    _, first = np.unique(predictions.prompt[order], return_index=True)
    return predictions[order[first]]
