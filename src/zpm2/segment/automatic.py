"""Segment everything: which points become prompts, and which of the predicted masks are regions of their own.

With every point of the grid as a prompt, this is SAM's automatic mask generator (Kirillov et al. 2023, Appendix B,
"Automatic Mask Generation") on one view of the image. Most of these prompts find the same regions again: on an aerial
photograph 1024 of them find two dozen. The faster levels of quality prompt in three steps:

1. at a few points of the grid, for large regions;
2. at blobs (`blobs`), the most contrasted first, unless a mask of about that size is there already;
3. at points of the grid outside the finest mask of every earlier prompt. Any first part of their order is spread evenly
   over the image.

Each prompt predicts a whole, a part and a subpart. A level of quality is a number of prompts (`config.prompts`).
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.model import Mask
from zpm2.segment import stacks, suppression
from zpm2.segment.blobs import blobs, has_data
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView, SmallThingsView
from zpm2.segment.stacks import Extent

Rows = NDArray[np.int64]


def automatic_masks(
    view: PromptedView,
    config: SegmentConfig,
    thresholds: MaskThresholds | None = None,
    known: MaskPredictions | None = None,
    progress: Callable[[float], None] = lambda _: None,
    where: NDArray[np.bool_] | None = None,
) -> MaskPredictions:
    """The regions of a view, `known` ones first, then by score, best first.

    `thresholds` default to `config`'s. `known` are masks of regions that were found before, best first: the faster
    levels make no prompts inside them, and a mask that overlaps one by more than `config.nms_iou` is the same region.
    `progress` receives the share that is done, 0..1. `where` (height, width) of a decoded mask holds the prompts; None:
    all of the view.
    """
    data = has_data(view.image, view.size)
    valid = data if where is None else where & data
    thresholds = thresholds or MaskThresholds(config.min_predicted_iou, config.min_stability)
    known = MaskPredictions.none(view.size) if known is None else known
    if config.quality == "full":
        found, points = list[MaskPredictions](), grid(config.grid, view.size)
        points, surest = points[valid[_pixels(points)]], _surest(known)
        prompts = Prompts.at(points / view.mask_scale)
        for start in range(0, len(points), view.batch):
            rows, following = (slice(first, first + view.batch) for first in (start, start + view.batch))
            found.append(_small(view, prompts[rows], thresholds, [surest, *found], prompts[following]))
            progress(min(1.0, (start + view.batch) / len(points)))
    else:
        found = _predict_selected(view, config, thresholds, known, (data, valid), progress)
    rank = np.concatenate([2.0 + np.arange(len(known), 0.0, -1.0), *(part.score for part in found)])
    return without_duplicates([known, *found], rank, config, view)


def regions(view: PromptedView, config: SegmentConfig, progress: Callable[[float], None]) -> list[Mask]:
    """The regions of a view at the image's resolution, best score first; those below `config.min_area` are left out."""
    found = view.masks(automatic_masks(view, config, progress=progress))
    return [mask for mask in found if mask.area >= config.min_area]


def _predict_selected(
    view: PromptedView,
    config: SegmentConfig,
    thresholds: MaskThresholds,
    known: MaskPredictions,
    pixels: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    progress: Callable[[float], None],
) -> list[MaskPredictions]:
    """The masks of the prompts of the faster levels, some at a time. The `pixels` are those with data, and those of
    them where prompts are made."""
    limits, fast = config.prompts, config.quality == "fast"
    points, coverage = grid(config.grid, view.size), _Coverage(view.size)
    data, valid = pixels
    spots = blobs(view.image, data, limits)
    coverage.add(known, np.arange(len(known)))
    coverage.covered |= ~valid
    shares = (
        limits.first,
        limits.fast_blobs if fast else limits.balanced_blobs,
        limits.fast_uncovered if fast else limits.balanced_uncovered,
    )
    first, most_blobs, most_uncovered = (max(1, round(share * len(points))) for share in shares)
    found: list[MaskPredictions] = []
    large, surest = points[:first], _surest(known)

    def predict(
        at: NDArray[np.float64], wanted: Callable[[Rows], NDArray[np.bool_]], most: int, done: int, small: bool = True
    ) -> None:
        """Prompts at up to `most` of the points, in their order, those that are still `wanted` when they are
        reached. They mostly show something `small`, or not."""

        def ask(rows: Rows, soon: Rows) -> MaskPredictions:
            prompts, following = (Prompts.at(at[each] / view.mask_scale) for each in (rows, soon))
            if small:
                return _small(view, prompts, thresholds, [surest, *found], following)
            return view.predict(prompts, thresholds)

        rows, prompted, answers = np.arange(len(at)), 0, _Batched(ask, view)
        while prompted < most and len(rows := rows[wanted(rows)]):
            chosen, rows = np.split(rows, [min(limits.chosen, most - prompted)])
            predictions = answers(chosen, rows[: most - prompted - len(chosen)])
            coverage.add(predictions, _finest_around(predictions, *_pixels(at[chosen])))
            found.append(predictions)
            prompted += len(chosen)
            progress((done + prompted) / (first + most_blobs + most_uncovered))

    def without_mask(rows: Rows) -> NDArray[np.bool_]:
        at = _pixels(spots.points[rows])
        return np.asarray(valid[at] & (coverage.smallest[at] > limits.max_mask_to_blob * spots.area[rows]))

    predict(large, lambda rows: ~coverage.covered[_pixels(large[rows])], first, 0, small=False)
    predict(spots.points, without_mask, most_blobs, first)
    rest = points[first:]
    predict(rest, lambda rows: ~coverage.covered[_pixels(rest[rows])], most_uncovered, first + most_blobs)
    progress(1.0)
    return found


def _small(
    view: PromptedView, prompts: Prompts, thresholds: MaskThresholds, known: list[MaskPredictions], soon: Prompts
) -> MaskPredictions:
    """The masks of prompts that mostly show something small; large ones are `known` by then. `soon` are likely to be
    the next prompts."""
    if isinstance(view, SmallThingsView):
        return view.predict_small(prompts, thresholds, known, soon)
    return view.predict(prompts, thresholds)


class _Batched:
    """The answers of a `view` to prompts that are chosen few at a time. Where a device takes more at a time, those that
    are likely to be next are asked with them, so that what is chosen does not depend on the device. `ask` gets these,
    and as many that are likely to follow."""

    def __init__(self, ask: Callable[[Rows, Rows], MaskPredictions], view: PromptedView) -> None:
        self._ask, self._batch = ask, view.batch
        self._last, self._answers = -1, MaskPredictions.none(view.size)  # `prompt` are rows

    def __call__(self, rows: Rows, following: Rows) -> MaskPredictions:
        """The masks of the prompts `rows`, in ascending order; `following` are those that may be next. What was not
        wanted once is not wanted later, so all that is wanted up to the last row that was asked has its answer."""
        new = rows[rows > self._last]
        if len(new):
            more = max(0, self._batch - len(new))
            asked, soon = np.concatenate([new, following[:more]]), following[more:][: self._batch]
            answers = self._ask(asked, soon)
            waiting = self._answers[np.isin(self._answers.prompt, rows)]
            self._answers = MaskPredictions.join([waiting, dataclasses.replace(answers, prompt=asked[answers.prompt])])
            self._last = int(asked[-1])
        found = self._answers[np.isin(self._answers.prompt, rows)]
        return dataclasses.replace(found, prompt=np.searchsorted(rows, found.prompt))


def _surest(known: MaskPredictions) -> MaskPredictions:
    """Masks that no other one of the same region replaces."""
    return dataclasses.replace(known, score=np.full(len(known), np.inf, np.float32))


class _Coverage:
    """Which pixels the masks so far cover."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.covered: NDArray[np.bool_] = np.zeros(size, bool)  # by the finest mask of a prompt, or without data
        self.smallest: NDArray[np.int32] = np.full(size, stacks.NO_MASK, np.int32)  # px^2, of masks that hold a pixel

    def add(self, predictions: MaskPredictions, finest: Rows) -> None:
        """Adds masks; the rows `finest` are those that are the finest of a prompt."""
        if not len(predictions):
            return
        union, smallest = stacks.painted(predictions.logits, predictions.extent, finest)
        self.covered |= union
        self.smallest = np.minimum(self.smallest, smallest)


def _pixels(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of (n, 2) points."""
    column, row = points.astype(np.int64).T
    return row, column


def grid(n: int, size: tuple[int, int]) -> NDArray[np.float64]:
    """(n * n, 2) x, y: the centres of n x n cells of a (height, width), in an order of which any first part is spread
    evenly: the black cells of a chessboard, of these every second row, and so on down to two cells."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    rank = np.zeros(x.shape, np.int64)
    for k in range((n - 1).bit_length()):  # the lowest bits weigh most
        rank = (rank << 2) | (((x >> k) ^ (y >> k)) & 1) << 1 | ((y >> k) & 1)
    order = np.argsort(rank.ravel(), kind="stable")
    return np.c_[(x.ravel()[order] + 0.5) * size[1] / n, (y.ravel()[order] + 0.5) * size[0] / n]


def without_duplicates(
    parts: Sequence[MaskPredictions], rank: NDArray[np.floating], config: SegmentConfig, view: PromptedView
) -> MaskPredictions:
    """One mask per region, highest `rank` (n,) first: of the masks of all parts that overlap by more than
    `config.nms_iou`, the one of highest rank. Masks that are too small or too large are dropped."""
    extent = Extent.join([part.extent for part in parts])
    area = extent.area
    pixels = area / view.mask_scale**2  # image px^2
    usable = (pixels >= config.min_decoded_area * config.min_area) & (area > 0)
    usable &= pixels <= config.max_area * view.image.width * view.image.height
    rows = np.flatnonzero(usable)
    logits = [part.logits for part in parts]
    return MaskPredictions.chosen(parts, suppression.suppress_stack(logits, extent, rank, config.nms_iou, rows))


def _finest_around(predictions: MaskPredictions, row: NDArray[np.int64], column: NDArray[np.int64]) -> Rows:
    """Of each prompt the row of the smallest mask that contains its own point."""
    prompt = predictions.prompt
    around = np.flatnonzero(stacks.holds(predictions.logits, row[prompt], column[prompt]))
    order = around[np.lexsort((predictions.extent.area[around], prompt[around]))]
    _, first = np.unique(prompt[order], return_index=True)
    return order[first]
