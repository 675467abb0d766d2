"""COCO's run-length encoding (RLE), both ways: pixels to run lengths, and run lengths to text.

Runs of background and mask alternate, background first, down the columns of an image. The text is that of COCO's
maskApi.c (rleToString, rleFrString): five bits a character, lowest bits first, and a sixth bit where the number
continues; from the fourth run on, each is stored as its difference to the run two before it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.model import Mask

MAX_DIGITS = 7  # of five bits each, including the sign: run lengths below 2 ** 34


def run_lengths(mask: Mask, width: int, height: int) -> NDArray[np.int64]:
    """(k,) lengths of the runs of a mask in an image of `width` x `height` px. The mask must lie inside.

    The first is 0 where the image's first pixel belongs to the mask.
    """
    h, w = mask.bits.shape
    columns = np.zeros((w, h + 2), bool)  # with background above and below, so that no run crosses columns
    columns[:, 1:-1] = mask.bits.T
    column, row = np.divmod(np.flatnonzero(columns[:, 1:] != columns[:, :-1]), h + 1)
    edges = np.zeros(len(row) + 2, np.int64)  # 0, then starts and ends alternately, then the end of the image
    edges[1:-1] = (column + mask.x0) * height + row + mask.y0
    edges[-1] = width * height
    counts = np.diff(edges)
    joined = np.flatnonzero(counts[2:-1:2] == 0) * 2 + 2  # runs that continue at the top of the next column
    if len(joined):
        edges = np.delete(edges, np.concatenate([joined, joined + 1]))
        counts = np.diff(edges)
    return counts[:-1] if len(counts) > 1 and counts[-1] == 0 else counts


def pixels(counts: Sequence[int], width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) mask from run lengths. `ValueError` where they do not add up to the image's size."""
    if any(n < 0 for n in counts) or sum(counts) != width * height:
        raise ValueError(f"has run lengths that do not add up to {width} x {height} px")
    bits = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
    return np.asarray(bits.reshape(width, height).T)


def compressed(counts: NDArray[np.int64]) -> str:
    """(k,) run lengths as COCO's text."""
    values = counts.copy()
    values[3:] -= counts[1:-2]
    shift = 5 * np.arange(MAX_DIGITS)
    digits = values[:, None] >> shift & 31
    rest = values[:, None] >> shift + 5
    more = rest != np.where(digits & 16, -1, 0)  # the last digit's highest bit is the sign
    used = np.arange(MAX_DIGITS) <= np.argmin(more, axis=1)[:, None]
    return (digits + 32 * more + 48)[used].astype(np.uint8).tobytes().decode("ascii")


def decompressed(text: str) -> list[int]:
    """The run lengths of COCO's text. `ValueError` where it is damaged (COCO's own reader does not check)."""
    codes = np.array([ord(character) - 48 for character in text], np.int64)
    last = codes & 32 == 0
    starts = np.flatnonzero(np.r_[True, last[:-1]])[: len(codes)]
    digit = np.arange(len(codes)) - np.repeat(starts, np.diff(np.r_[starts, len(codes)]))
    if not len(codes) or not last[-1] or (codes < 0).any() or (codes > 63).any() or digit.max() >= MAX_DIGITS:
        raise ValueError("has a compressed RLE that is damaged")
    numbers = np.add.reduceat((codes & 31) << (5 * digit), starts)
    numbers -= np.where(codes[last] & 16, 1 << (5 * (digit[last] + 1)), 0)
    numbers[1::2] = np.cumsum(numbers[1::2])
    numbers[2::2] = np.cumsum(numbers[2::2])
    return [int(n) for n in numbers]
