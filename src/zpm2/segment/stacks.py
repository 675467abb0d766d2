"""Stacks of masks at the decoder's resolution, in the memory of the device that computed them.

A network on a CPU leaves numpy arrays, one on a GPU leaves torch tensors there. Which masks stay, and which show the
same region, is decided in one place for both, by numbers that are read off a stack here. On a GPU such a reading is one
transfer of these numbers, and pixels stay there until `to_host` or `enlarged` asks for them (`device_stacks`).

Numpy is no reference only: what it does with bits on a CPU takes torch there three to sixty times as long. So a network
in torch on a CPU gives arrays, which share its memory. Both give the same whole numbers (`test_stacks.py`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Union

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

Bits = NDArray[np.bool_]
Stack = Union[NDArray[np.floating], "Tensor"]  # (n, height, width) logits
BitStack = Union[Bits, "Tensor"]  # (n, height, width)
Rows = NDArray[np.intp]
Counts = NDArray[np.int64]
MAX_LOGIT = 60.0  # beyond which a logit says nothing more; fits into 16 bits
NO_MASK = 1 << 30  # px^2, in place of the area of a mask where there is none


@dataclass(frozen=True, eq=False)
class Extent:
    """Where n masks lie, px of a decoded mask."""

    area: Counts  # (n,) px^2
    box: Counts  # (n, 4) first and one-past-last column and row: x0, y0, x1, y1; of an empty mask, all of the view

    def __getitem__(self, rows: Rows | Bits) -> "Extent":
        return Extent(self.area[rows], self.box[rows])

    @staticmethod
    def join(parts: "Sequence[Extent]") -> "Extent":
        """One after the other."""
        return Extent(np.concatenate([part.area for part in parts]), np.concatenate([part.box for part in parts]))


def to_host(bits: BitStack) -> Bits:
    """As an array."""
    if isinstance(bits, np.ndarray):
        return bits
    from zpm2.segment import device_stacks

    return np.asarray(device_stacks.to_host(bits)[0], np.bool_)


def inside(logits: Stack) -> BitStack:
    """(n, height, width) bool, where logits are above 0."""
    if isinstance(logits, np.ndarray) and logits.dtype == np.float16:
        return np.asarray(logits.view(np.int16) > 0)  # the same, 40 times as fast
    return np.asarray(logits > 0) if isinstance(logits, np.ndarray) else logits > 0


def take(stack: Stack, rows: Rows) -> Stack:
    """Rows of a stack."""
    if isinstance(stack, np.ndarray):
        return stack[rows]
    from zpm2.segment import device_stacks

    return device_stacks.take(stack, rows)


def chosen(stacks: Sequence[Stack], of: Rows, rows: Rows) -> Stack:
    """Row `rows[k]` (n,) of stack `of[k]`. Nothing else is copied."""
    if not all(isinstance(stacks[k], np.ndarray) for k in np.unique(of)):
        from zpm2.segment import device_stacks

        return device_stacks.chosen(stacks, of, rows)
    like = stacks[of[0] if len(of) else 0]
    result = np.empty((len(rows), *like.shape[1:]), np.float16)
    for canvas, k, row in zip(result, of, rows, strict=True):
        canvas[:] = stacks[k][row]
    return result


def join(stacks: Sequence[Stack]) -> Stack:
    """One after the other, on a device where one of them is."""
    arrays = [stack for stack in stacks if isinstance(stack, np.ndarray)]
    if len(arrays) == len(stacks):
        return np.concatenate(arrays)
    from zpm2.segment import device_stacks

    return device_stacks.join(stacks)


def counts(bits: BitStack) -> Counts:
    """(n,) pixels of each."""
    if isinstance(bits, np.ndarray):
        return np.array([np.count_nonzero(each) for each in bits], np.int64)
    from zpm2.segment import device_stacks

    return device_stacks.counts(bits)


def boxes(bits: Bits) -> Counts:
    """(n, 4), as in `Extent`."""
    return boxes_by_lines(np.logical_or.reduce(bits, 1), np.logical_or.reduce(bits, 2))


def boxes_by_lines(columns: Bits, rows: Bits) -> Counts:
    """(n, 4), as in `Extent`, by (n, w) and (n, h): which columns and rows hold a pixel of each."""
    w, h = columns.shape[1], rows.shape[1]
    return np.stack(
        [columns.argmax(1), rows.argmax(1), w - columns[:, ::-1].argmax(1), h - rows[:, ::-1].argmax(1)], axis=1
    )


def extent(logits: Stack) -> Extent:
    """Where masks lie."""
    bits = inside(logits)
    if isinstance(bits, np.ndarray):
        return Extent(counts(bits), boxes(bits))
    from zpm2.segment import device_stacks

    return device_stacks.extent(bits)


def settled(logits: Stack, offset: float, wanted: Callable[[Counts, Counts], Rows]) -> tuple[Rows, Stack, Extent]:
    """The masks (n, height, width), single precision, that are `wanted` by their pixels (n,) above `offset` and above
    `-offset`: their rows, their logits in half precision within `MAX_LOGIT`, and where they lie."""
    if not isinstance(logits, np.ndarray):
        from zpm2.segment import device_stacks

        return device_stacks.settled(logits, offset, wanted)
    rows = wanted(counts(logits > offset), counts(logits > -offset))
    half = np.clip(logits[rows], -MAX_LOGIT, MAX_LOGIT).astype(np.float16)
    return rows, half, extent(half)


def holds(logits: Stack, row: Counts, column: Counts) -> Bits:
    """(n,) whether each mask holds one pixel."""
    if isinstance(logits, np.ndarray):
        return np.asarray(logits[np.arange(len(logits)), row, column] > 0)
    from zpm2.segment import device_stacks

    return device_stacks.holds(logits, row, column)


def painted(logits: Stack, extent: Extent, chosen: Rows) -> tuple[Bits, NDArray[np.int32]]:
    """(height, width) the pixels of the masks `chosen`, and the area of the smallest of all masks that holds a pixel
    (`NO_MASK` where none does)."""
    bits = inside(logits)
    if not isinstance(bits, np.ndarray):
        from zpm2.segment import device_stacks

        return device_stacks.painted(bits, extent, chosen)
    smallest = np.full(bits.shape[1:], NO_MASK, np.int32)
    for mask, (x0, y0, x1, y1), pixels in zip(bits, extent.box, extent.area, strict=True):
        part = smallest[y0:y1, x0:x1]
        np.minimum(part, np.int32(pixels), out=part, where=mask[y0:y1, x0:x1])
    return np.asarray(bits[chosen].any(0)), smallest


def shared(bits: BitStack, other: BitStack, of: Rows | Counts) -> Counts:
    """(n,) pixels that each of (n, height, width) `bits` has in common with row `of[k]` of `other`."""
    if isinstance(bits, np.ndarray) and isinstance(other, np.ndarray):
        return np.array([np.count_nonzero(mask & other[k]) for mask, k in zip(bits, of, strict=True)], np.int64)
    from zpm2.segment import device_stacks

    return device_stacks.shared(bits, other, of)


def limited(bits: BitStack, rows: Rows, to: Bits) -> BitStack:
    """A copy of (n, height, width) `bits` of which the (k,) `rows` keep the pixels of (k, height, width) `to`."""
    if not isinstance(bits, np.ndarray):
        from zpm2.segment import device_stacks

        return device_stacks.limited(bits, rows, to)
    kept = bits.copy()
    kept[rows] &= to
    return kept


def cropped(logits: Stack, height: Counts, width: Counts) -> Stack:
    """(n, m, h, w) logits without what lies beyond the first `height` rows and `width` columns (n,) of each."""
    _, _, h, w = logits.shape
    beyond = (np.arange(h)[:, None] >= height[:, None, None]) | (np.arange(w) >= width[:, None, None])
    if not beyond.any():
        return logits
    if isinstance(logits, np.ndarray):
        return np.where(beyond[:, None], np.float32(-MAX_LOGIT), logits)
    from zpm2.segment import device_stacks

    return device_stacks.cropped(logits, beyond)


def placed(logits: Stack, corner: Counts, size: tuple[int, int]) -> Stack:
    """(n, height, width) of `size`: logits (n, h, w) with their first row and column at `corner` (n, 2), and nothing
    around them. What lies beyond `size` is left out."""
    if not isinstance(logits, np.ndarray):
        from zpm2.segment import device_stacks

        return device_stacks.placed(logits, corner, size)
    result = np.full((len(logits), *size), -MAX_LOGIT, logits.dtype)
    for canvas, part, (row, column) in zip(result, logits, corner, strict=True):
        there = canvas[row : row + part.shape[0], column : column + part.shape[1]]
        there[:] = part[: there.shape[0], : there.shape[1]]
    return result
