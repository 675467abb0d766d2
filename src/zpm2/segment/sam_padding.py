"""The empty part of SAM's square, told by few of its image tokens.

SAM sees a photograph in a square of 64 x 64 image tokens, and every prompt attends to all of them: of a street of
1242 x 375 px, two thirds are empty. They say the same, but they may not be left out: prompts attend to them where
nothing else fits, and without them the masks are other ones. So some of them, evenly spread, stand for all: in the
softmax of an attention, a token that stands for n weighs n times, which is its score plus log(n). Tokens of the
photograph itself all stay, as each carries a part of the mask.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

GRID = 64  # image tokens along a side
STEP = 256  # image tokens are a multiple of it, so that few networks of a fixed size serve photographs of any shape


@dataclass(frozen=True, eq=False)
class ThinnedTokens:
    """N of the 4096 image tokens: first those of the photograph, row by row."""

    rows: NDArray[np.int64]  # (N,)
    log_count: NDArray[np.float32]  # (N,) logarithm of how many it stands for


def thinned(size: tuple[int, int], least: int) -> ThinnedTokens | None:
    """The image tokens of a photograph of `size` (height, width) tokens, with at least so many of its empty part; None
    where that is all of them."""
    photograph, empty = split(size)
    number = -(-(len(photograph) + least) // STEP) * STEP
    if number >= GRID * GRID:
        return None
    chosen = number - len(photograph)
    spread = evenly(empty[np.argsort(_along_curve(empty), kind="stable")], chosen)
    counts = np.append(np.zeros(len(photograph)), np.full(chosen, np.log(len(empty) / chosen)))
    return ThinnedTokens(np.append(photograph, spread), counts.astype(np.float32))


def split(size: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The tokens of the square that a photograph of `size` (height, width) tokens fills, and those that it leaves
    empty."""
    every = np.arange(GRID * GRID).reshape(GRID, GRID)
    photograph = every[: size[0], : size[1]].ravel()
    return photograph, np.setdiff1d(every, photograph)


def evenly(tokens: NDArray[np.int64], number: int) -> NDArray[np.int64]:
    """So many of one or more tokens, evenly spread; some of them again where there are fewer."""
    return tokens[((np.arange(number) + 0.5) * len(tokens) / number).astype(np.int64)]


def _along_curve(tokens: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) where tokens lie on a Z-curve (Morton 1966) through the square: neighbours on it are near each other."""
    row, column = tokens // GRID, tokens % GRID
    place = np.zeros(len(tokens), np.int64)
    for bit in range((GRID - 1).bit_length()):
        place |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return place
