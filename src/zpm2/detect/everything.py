"""Segment everything: which prompts to ask, and which of the answers are regions of their own.

With every point of the grid asked, this is SAM's automatic mask generator (Kirillov et al. 2023, Appendix B, "Automatic
Mask Generation") on one view of the image. The faster levels of quality ask first where something new may lie: outside
of the finest mask of every prompt asked before, then close to the border of one, and so on inwards; well inside, the
answer would be that prompt's. Points of equal depth are asked in an order of which any first part is spread over the
image. Whole, part and subpart come with every prompt; what lies in the holes of a fine mask or beside it is outside of
it, what lies inside it may be missed. A level of quality is how deep it goes, and how many points it asks at least.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.detect import masks
from zpm2.detect.answers import Answers, Floor, Prompts
from zpm2.detect.protocol import PromptedView

DEPTH = {"fast": 0.0, "balanced": 1.0}  # px of a decoded mask: points deeper inside a fine mask are not asked,
LEAST = {"fast": 1 / 6, "balanced": 1 / 3}  # but for this share of the grid, least deep first
CHUNK = 256  # masks looked at at a time; one takes up to 64 kB


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
    known = Answers.none(view.size) if known is None else known
    found, points = [], grid(config.grid, view.size)
    if config.quality == "full":
        for start in range(0, len(points), view.batch):
            found.append(view.ask(Prompts.at(points[start : start + view.batch] / view.low), floor))
            progress(min(1.0, (start + view.batch) / len(points)))
    else:
        deepest, least = DEPTH[config.quality], round(LEAST[config.quality] * len(points)) - len(known)
        depth = _depth(np.zeros(view.size, np.float32), known.bits)
        row, column = points.astype(int).T[::-1]
        waiting, count = np.arange(len(points)), 0
        while len(waiting):
            deep = np.floor(depth[row[waiting], column[waiting]])
            order = np.argsort(deep, kind="stable")[: view.batch]
            order = order[(deep[order] <= deepest) | (count + np.arange(len(order)) < least)]
            if len(order) == 0:
                break
            asked, waiting, count = waiting[order], np.delete(waiting, order), count + len(order)
            answers = view.ask(Prompts.at(points[asked] / view.low), floor)
            depth = _depth(depth, _finest_around(answers, row[asked], column[asked]).bits)
            found.append(answers)
            progress(1.0 - len(waiting) / len(points))
        progress(1.0)
    answers = Answers.join([known, *found])
    del found
    rank = answers.score.astype(np.float64)
    rank[: len(known)] = 2.0 + np.arange(len(known), 0.0, -1.0)
    return distinct(answers, rank, config, view)


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
    area = np.array([np.count_nonzero(logits > 0) for logits in answers.logits], np.int64)
    pixels = area / view.low**2  # image px^2
    usable = (pixels >= config.min_area / 2) & (area > 0)
    usable &= pixels <= config.max_area * view.image.width * view.image.height
    rows = np.flatnonzero(usable)
    if len(rows) == 0:
        return answers[rows]
    chunks = (answers.logits[rows[k : k + CHUNK]] > 0 for k in range(0, len(rows), CHUNK))
    packed, box = map(np.concatenate, zip(*((masks.pack(bits), masks.boxes(bits)) for bits in chunks), strict=True))
    return answers[rows[masks.suppress(packed, box, area[rows], rank[rows], config.nms_iou)]]


def _depth(depth: NDArray[np.float32], fine: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(h, w) px, how deep each pixel lies inside any of the masks: `depth` and the `fine` ones (n, h, w)."""
    for bits in fine:
        inside = cv2.distanceTransform(np.pad(bits, 1).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        depth = np.maximum(depth, inside[1:-1, 1:-1])
    return depth


def _finest_around(answers: Answers, row: NDArray[np.int64], column: NDArray[np.int64]) -> Answers:
    """Of each prompt the smallest mask that contains its own point."""
    bits = answers.bits
    around = np.flatnonzero(bits[np.arange(len(bits)), row[answers.prompt], column[answers.prompt]])
    area = bits[around].sum((1, 2))
    order = around[np.lexsort((area, answers.prompt[around]))]
    _, first = np.unique(answers.prompt[order], return_index=True)
    return answers[order[first]]
