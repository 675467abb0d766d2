"""Segment everything: which prompts to ask, and which of the answers are regions of their own.

With every point of the grid asked, this is SAM's automatic mask generator (Kirillov et al. 2023, Appendix B, "Automatic
Mask Generation") on one view of the image. The faster levels of quality ask the same points in an order in which any
first part of them is spread over the image, and leave out those that lie well inside the finest mask of a prompt asked
before: there, the answer would be that prompt's. Whole, part and subpart all come with every prompt; what lies in the
holes of a fine mask, beside it, or along its border is still asked about.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.detect import masks
from zpm2.detect.answers import LOW, Answers, Floor, Prompts
from zpm2.detect.protocol import PromptedView

MARGIN = {"fast": 0, "balanced": 1}  # px of a decoded mask: closer to a fine mask's border, points are still asked


def everything(
    view: PromptedView,
    config: SegmentConfig,
    floor: Floor | None = None,
    known: Answers | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Answers:
    """The regions of a view that the grid finds, best score first, `known` ones before all others.

    `floor` is `config`'s, if no other is given. `known` are answers that are regions already, the best one first: where
    they are fine no point is asked, and what overlaps one of them by more than `config.nms_iou` is the same region.
    """
    floor = floor or Floor(config.min_predicted_iou, config.min_stability)
    known = Answers.none() if known is None else known
    found, points = [], grid(config.grid, view.size)
    if config.quality == "full":
        for start in range(0, len(points), view.batch):
            found.append(view.ask(Prompts.at(points[start : start + view.batch] / view.low), floor))
            progress(min(1.0, (start + view.batch) / len(points)))
    else:
        margin = MARGIN[config.quality]
        free = np.ones((LOW, LOW), bool)
        _answered(free, known, margin)
        column, row = np.minimum(points.astype(int), LOW - 1).T
        waiting = np.arange(len(points))
        while len(waiting := waiting[free[row[waiting], column[waiting]]]):
            asked, waiting = waiting[: view.batch], waiting[view.batch :]
            answers = view.ask(Prompts.at(points[asked] / view.low), floor)
            _answered(free, _finest_around(answers, row[asked], column[asked]), margin)
            found.append(answers)
            progress(1.0 - len(waiting) / len(points))
    new = Answers.join(found)
    rank = np.append(2.0 + np.arange(len(known), 0.0, -1.0), new.score.astype(np.float64))
    return distinct(Answers.join([known, new]), rank, config, view)


def grid(n: int, size: tuple[int, int]) -> NDArray[np.float64]:
    """(n * n, 2) x, y: the centres of n x n cells of a (height, width), in an order of which each first part is spread
    evenly: every second cell of a chessboard, of these every second row, and so on down to two cells."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    rank = np.zeros(x.shape, np.int64)
    for k in range((n - 1).bit_length()):  # the lowest bits weigh most
        rank = (rank << 2) | (((x >> k) ^ (y >> k)) & 1) << 1 | ((y >> k) & 1)
    order = np.argsort(rank.ravel(), kind="stable")
    return np.c_[(x.ravel()[order] + 0.5) * size[1] / n, (y.ravel()[order] + 0.5) * size[0] / n]


def distinct(answers: Answers, rank: NDArray[np.floating], config: SegmentConfig, view: PromptedView) -> Answers:
    """Without masks that are too small or too large, and of those that show the same region the one of highest `rank`
    (n,); highest rank first."""
    if len(answers) == 0:
        return answers
    bits = answers.bits
    area = bits.sum((1, 2), dtype=np.int64)
    pixels = area / view.low**2  # image px^2
    usable = (pixels >= config.min_area / 2) & (area > 0)
    usable &= pixels <= config.max_area * view.image.width * view.image.height
    answers, bits, area = answers[usable], bits[usable], area[usable]
    if len(answers) == 0:
        return answers
    return answers[masks.suppress(masks.pack(bits), masks.boxes(bits), area, rank[usable], config.nms_iou)]


def _answered(free: NDArray[np.bool_], fine: Answers, margin: int) -> None:
    """Takes what lies more than `margin` px inside one of the masks out of `free`."""
    kernel = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    for bits in fine.bits:
        free &= cv2.erode(bits.view(np.uint8), kernel) == 0


def _finest_around(answers: Answers, row: NDArray[np.int64], column: NDArray[np.int64]) -> Answers:
    """Of each prompt the smallest mask that contains its own point."""
    bits = answers.bits
    around = np.flatnonzero(bits[np.arange(len(bits)), row[answers.prompt], column[answers.prompt]])
    area = bits[around].sum((1, 2))
    order = around[np.lexsort((area, answers.prompt[around]))]
    _, first = np.unique(answers.prompt[order], return_index=True)
    return answers[order[first]]
