"""Non-maximum suppression of masks at the decoder's resolution."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.segment import stacks
from zpm2.segment.predictions import MaskPredictions
from zpm2.segment.stacks import Extent, Stack, boxes

__all__ = ["alike_inside", "boxes", "leaders", "pack", "suppress", "suppress_stack"]
Rows = NDArray[np.intp]
WORDS_CHUNK = 256  # masks that are packed at a time; their bits take up to 64 kB each


def pack(bits: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """(n, h, w) bool -> (n, h w / 64) words, so that an intersection is an AND and a popcount. h w divides by 64."""
    return np.packbits(bits.reshape(len(bits), -1), axis=1).view(np.uint64)


def suppress(
    packed: NDArray[np.uint64],
    box: NDArray[np.int64],
    area: NDArray[np.int64],
    score: NDArray[np.floating],
    threshold: float,
) -> Rows:
    """Greedy non-maximum suppression on masks (not their boxes): the indices that stay, best score first.

    A mask goes if its IoU with a better one that stays exceeds `threshold`. IoU is at most the ratio of the two areas,
    which decides most pairs without looking at a pixel.
    """
    return _kept(leaders(packed, box, area, score, threshold), score)


def suppress_stack(
    logits: Sequence[Stack], extent: Extent, score: NDArray[np.floating], threshold: float, rows: Rows
) -> Rows:
    """`suppress` of the masks `rows` of some stacks, one after the other, by their logits, where these are: a device
    compares all pairs at once."""
    extent, score = extent[rows], score[rows]
    if not len(rows):
        return rows
    if not all(isinstance(stack, np.ndarray) for stack in logits):
        from zpm2.segment import device_stacks

        every = device_stacks.take(device_stacks.join(logits), rows)
        alike = device_stacks.alike(every, extent.area, threshold)
        return rows[_kept(_greedy(score, lambda i, free: np.flatnonzero(alike[i] & free)), score)]
    parts = (stack[k : k + WORDS_CHUNK] for stack in logits for k in range(0, len(stack), WORDS_CHUNK))
    packed = np.concatenate([pack(stacks.to_host(stacks.inside(part))) for part in parts])[rows]
    return rows[suppress(packed, extent.box, extent.area, score, threshold)]


def leaders(
    packed: NDArray[np.uint64],
    box: NDArray[np.int64],
    area: NDArray[np.int64],
    score: NDArray[np.floating],
    threshold: float,
) -> Rows:
    """(n,) for each mask the best one that it is suppressed by (`suppress`): itself where it stays."""

    def alike(i: int, free: NDArray[np.bool_]) -> Rows:
        near = free & (np.minimum(area, area[i]) > threshold * np.maximum(area, area[i]))
        near &= (box[:, :2] < box[i, 2:]).all(1) & (box[i, :2] < box[:, 2:]).all(1)
        rivals = np.flatnonzero(near)
        shared = np.bitwise_count(packed[rivals] & packed[i]).sum(1, dtype=np.int64)
        return rivals[shared > threshold * (area[rivals] + area[i] - shared)]

    return _greedy(score, alike)


def alike_inside(
    masks: MaskPredictions, known: Sequence[MaskPredictions], window: NDArray[np.int64], threshold: float
) -> tuple[Rows, MaskPredictions]:
    """Rows of masks (n,) and, for each of them, the `known` mask that looks most like it inside its `window` (n, 4), px
    of a decoded mask: of those of no lower score, whose IoU there is above a `threshold`. The masks lie in their
    windows."""
    score = np.concatenate([part.score for part in known])
    extents = np.concatenate([np.c_[part.extent.area, part.extent.box] for part in known])
    best = np.argsort(-score, kind="stable")
    numbers, first = np.unique(extents[best], axis=0, return_index=True)  # a mask may be known several times
    first = best[first]
    area, box = masks.extent.area, masks.extent.box
    low, high = np.maximum(box[:, None, :2], numbers[:, 1:3]), np.minimum(box[:, None, 2:], numbers[:, 3:])
    most = np.minimum(np.maximum(high - low, 0).prod(2), numbers[:, 0])  # px in common, at most
    row, k = np.nonzero((most > threshold * area[:, None]) & (score[first] >= masks.score[:, None]))
    frame = np.zeros((len(masks), *masks.logits.shape[1:]), bool)
    for canvas, (x0, y0, x1, y1) in zip(frame, window, strict=True):
        canvas[y0:y1, x0:x1] = True
    bits = MaskPredictions.chosen(known, first[k]).inside
    both, there = stacks.shared(bits, masks.inside, row), stacks.shared(bits, frame, row)
    overlap = both / np.maximum(area[row] + there - both, 1)
    order = np.lexsort((-overlap, row))
    order = order[overlap[order] > threshold]
    found, at = np.unique(row[order], return_index=True)
    return found, MaskPredictions.chosen(known, first[k[order[at]]])


def _greedy(score: NDArray[np.floating], alike: Callable[[int, NDArray[np.bool_]], Rows]) -> Rows:
    """`leaders`; `alike(i, free)` are the rows, of those that are `free`, that overlap mask i too much."""
    found = np.full(len(score), -1, np.intp)
    for i in np.argsort(-score, kind="stable"):
        if found[i] < 0:
            found[i] = i
            found[alike(int(i), found < 0)] = i
    return found


def _kept(leader: Rows, score: NDArray[np.floating]) -> Rows:
    order = np.argsort(-score, kind="stable")
    return np.asarray(order[leader[order] == order], np.intp)
