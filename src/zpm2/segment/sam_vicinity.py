"""What a prompt for something small sees of a photograph: all image tokens around it, and few of the rest.

SAM sees a photograph as 64 x 64 image tokens, and every prompt attends to all of them. For a thing of a few tokens most
of them are context, which one token of each block of 4 x 4 tells nearly as well: as in `sam_padding`, a token that
stands for n weighs n times. The mask is decoded in the window around the prompt only. A mask that reaches a border of
the window may be cut off by it; then the prompt needs the whole photograph.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zpm2.segment.sam_padding import GRID, ThinnedTokens, evenly, split

BLOCK = 4  # tokens along the side of a block; windows consist of whole blocks
TOKEN_PX = 4  # px of a decoded mask under an image token, along each side
LEAST_PADDING = 48  # tokens that tell the empty part of the square
STEP = 64  # tokens in sight are a multiple of it, so that few networks of a fixed size serve photographs of any shape
MARGIN = 2  # tokens, at least, between a prompt's box and a border of its window
RIM = 1  # tokens: a mask that comes as near to a border of its window is cut off by it
HIDDEN = -1e4  # logarithm of a count, of a token that is not seen

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NearTokens:
    """The image tokens that each of n prompts sees: first those of its window, row by row, then few of the rest."""

    rows: NDArray[np.int64]  # (n, N) of the tokens that the view has
    log_count: NDArray[np.float32]  # (n, N) logarithm of how many each stands for; HIDDEN: not seen

    def __getitem__(self, part: slice | NDArray[np.intp]) -> "NearTokens":
        return NearTokens(self.rows[part], self.log_count[part])


@dataclass(frozen=True, eq=False)
class Vicinity:
    """Windows of `blocks` x `blocks` in a photograph of `cells` (height, width) tokens.

    `tokens` are those that the view has (`sam_padding.thinned`), None: all.
    """

    cells: tuple[int, int]
    blocks: int
    tokens: ThinnedTokens | None

    @cached_property
    def size(self) -> tuple[int, int]:
        """(height, width) of a window, tokens."""
        side = BLOCK * self.blocks
        return min(side, _whole(self.cells[0])), min(side, _whole(self.cells[1]))

    @cached_property
    def last(self) -> NDArray[np.int64]:
        """(2,) row and column where the last windows begin, tokens."""
        return np.array([_whole(side) for side in self.cells], np.int64) - np.array(self.size, np.int64)

    @property
    def saves(self) -> bool:
        """Whether a window is less than the photograph."""
        return self.size[0] < self.cells[0] or self.size[1] < self.cells[1]

    def origins(self, boxes: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Boxes (n, 4), px of a decoded mask -> the first row and column of a window around each (n, 2), tokens, and
        whether it holds the box (n,)."""
        low, high = boxes[:, [1, 0]] / TOKEN_PX, boxes[:, [3, 2]] / TOKEN_PX
        origin = BLOCK * np.rint((low + high - self.size) / 2 / BLOCK).astype(np.int64)
        origin = np.clip(origin, 0, self.last)
        before = (low >= origin + MARGIN) | (origin == 0)
        after = (high <= origin + self.size - MARGIN) | (origin == self.last)
        return origin, np.asarray((before & after).all(1))

    def near(self, origins: NDArray[np.int64]) -> NearTokens:
        """The tokens that prompts with these windows (n, 2) see."""
        height, width = self.size
        row = origins[:, 0, None, None] + np.arange(height)[:, None]
        column = origins[:, 1, None, None] + np.arange(width)
        exists = (row < self.cells[0]) & (column < self.cells[1])
        here = np.where(exists, self._row_of[np.minimum(row, GRID - 1), np.minimum(column, GRID - 1)], 0)
        rest, count, at = self._rest
        inside = ((at >= origins[:, None]) & (at < origins[:, None] + self.size)).all(2)
        number = len(origins)
        rows = np.concatenate([here.reshape(number, -1), np.broadcast_to(rest, (number, len(rest)))], axis=1)
        counts = np.concatenate(
            [np.where(exists, 0.0, HIDDEN).reshape(number, -1), np.where(inside, HIDDEN, count)], axis=1
        )
        return NearTokens(rows, counts.astype(np.float32))

    def cut(self, boxes: NDArray[np.int64], origins: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(n,) which masks reach a border of their window that is none of the photograph; `boxes` (n, 4) px of a
        decoded mask, from the corner of the window."""
        rim, ends = RIM * TOKEN_PX, TOKEN_PX * np.array(self.size)
        before = (boxes[:, [1, 0]] < rim) & (origins > 0)
        after = (boxes[:, [3, 2]] > ends - rim) & (origins < self.last)
        return np.asarray((before | after).any(1))

    @cached_property
    def _row_of(self) -> NDArray[np.int64]:
        """(64, 64) the row of each token of the square among those that the view has, 0 where it has it not."""
        if self.tokens is None:
            return np.arange(GRID * GRID).reshape(GRID, GRID)
        result = np.zeros(GRID * GRID, np.int64)
        result[self.tokens.rows] = np.arange(len(self.tokens.rows))
        return result.reshape(GRID, GRID)

    @cached_property
    def _rest(self) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
        """One token of each block, and some of the empty part: rows (m,), logarithm of how many it stands for (m,), and
        the first row and column of its block (m, 2), beyond the square for the empty part."""
        row, top, high = _blocks(self.cells[0])
        column, left, wide = _blocks(self.cells[1])
        rows, counts = self._row_of[np.ix_(row, column)].ravel(), np.log(np.outer(high, wide).ravel())
        at = np.stack(np.meshgrid(top, left, indexing="ij"), -1).reshape(-1, 2)
        empty = self._empty
        number = self.size[0] * self.size[1] + len(rows)
        more = -(number + min(LEAST_PADDING, len(empty))) // STEP * -STEP - number
        if len(empty):
            spread = evenly(empty, more)
            told = np.log((GRID * GRID - self.cells[0] * self.cells[1]) / more)
        else:
            spread, told = np.zeros(more, np.int64), HIDDEN
        beyond = np.full((more, 2), 2 * GRID)
        return np.append(rows, spread), np.append(counts, np.full(more, told)), np.concatenate([at, beyond])

    @property
    def _empty(self) -> NDArray[np.int64]:
        """The rows of the tokens of the empty part that the view has."""
        if self.tokens is not None:
            return np.arange(self.cells[0] * self.cells[1], len(self.tokens.rows))
        return split(self.cells)[1]


def _whole(side: int) -> int:
    """Tokens of the blocks that hold so many."""
    return -(-side // BLOCK) * BLOCK


def _blocks(side: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Of the blocks along a side of so many tokens: a token in the middle, the first one, and how many there are."""
    first = np.arange(0, side, BLOCK)
    number = np.minimum(BLOCK, side - first)
    return first + number // 2, first, number
