"""Non-maximum suppression of masks at the decoder's resolution."""

import numpy as np
from numpy.typing import NDArray


def pack(bits: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """(n, h, w) bool -> (n, h w / 64) words, so that an intersection is an AND and a popcount. h w divides by 64."""
    return np.packbits(bits.reshape(len(bits), -1), axis=1).view(np.uint64)


def boxes(bits: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(n, h, w) bool, none empty -> (n, 4) first and one-past-last column and row: x0, y0, x1, y1."""
    columns, rows = np.logical_or.reduce(bits, 1), np.logical_or.reduce(bits, 2)
    w, h = columns.shape[1], rows.shape[1]
    return np.stack(
        [columns.argmax(1), rows.argmax(1), w - columns[:, ::-1].argmax(1), h - rows[:, ::-1].argmax(1)], axis=1
    )


def suppress(
    packed: NDArray[np.uint64],
    box: NDArray[np.int64],
    area: NDArray[np.int64],
    score: NDArray[np.floating],
    threshold: float,
) -> NDArray[np.intp]:
    """Greedy non-maximum suppression on masks (not their boxes): the indices that stay, best score first.

    A mask goes if its IoU with a better one that stays exceeds `threshold`. IoU is at most the ratio of the two areas,
    which decides most pairs without looking at a pixel.
    """
    leader = leaders(packed, box, area, score, threshold)
    order = np.argsort(-score, kind="stable")
    return np.asarray(order[leader[order] == order], np.intp)


def leaders(
    packed: NDArray[np.uint64],
    box: NDArray[np.int64],
    area: NDArray[np.int64],
    score: NDArray[np.floating],
    threshold: float,
) -> NDArray[np.intp]:
    """(n,) for each mask the best one that it is suppressed by (`suppress`): itself where it stays."""
    found = np.full(len(score), -1, np.intp)
    for i in np.argsort(-score, kind="stable"):
        if found[i] >= 0:
            continue
        found[i] = i
        near = (found < 0) & (np.minimum(area, area[i]) > threshold * np.maximum(area, area[i]))
        near &= (box[:, :2] < box[i, 2:]).all(1) & (box[i, :2] < box[:, 2:]).all(1)
        rivals = np.flatnonzero(near)
        shared = np.bitwise_count(packed[rivals] & packed[i]).sum(1, dtype=np.int64)
        found[rivals[shared > threshold * (area[rivals] + area[i] - shared)]] = i
    return found
