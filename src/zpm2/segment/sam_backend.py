"""What runs SAM's three networks: torch (the reference, and what a GPU uses) or OpenVINO (faster on a CPU)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2.segment.sam_padding import GRID, ThinnedTokens
from zpm2.segment.sam_vicinity import TOKEN_PX, NearTokens
from zpm2.segment.stacks import Rows, Stack

if TYPE_CHECKING:
    from torch import Tensor

Array = NDArray[np.float32]
Opaque = Any  # what a backend returns and only that backend reads: torch's tensors or arrays
Tokens = TypeVar("Tokens", "Tensor", Array)

WEIGHTS = {"mobile_sam": "mobile_sam", "vit_b": "sam_vit_b", "vit_l": "sam_vit_l", "vit_h": "sam_vit_h"}


@dataclass(frozen=True, eq=False)
class EmbeddedPrompts:
    """n prompts as the networks take them."""

    sparse: Array  # (n, P, 256) `sam_network.PromptEmbedding`
    near: NearTokens | None = None  # the image tokens that each sees; None: all of the view

    def __len__(self) -> int:
        return len(self.sparse)

    def __getitem__(self, rows: Rows | slice) -> "EmbeddedPrompts":
        return EmbeddedPrompts(self.sparse[rows], None if self.near is None else self.near[rows])


class SamBackend(Protocol):
    """The three networks of `sam_network`, arrays in and arrays out. Only `masks` and `tokens` read what `image`
    returns."""

    name: str
    batch: int  # prompts at a time, at most; each takes 4 MB of image tokens

    def embed(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> Array:
        """`sam_network.PromptEmbedding`."""

    def image(self, pixels: Array) -> Opaque:
        """(1, 3, 1024, 1024) -> the parts that do not depend on the prompt."""

    def thinned(self, parts: Opaque, tokens: ThinnedTokens) -> Opaque:
        """What `image` returned, of some of the image tokens."""

    def tokens(self, parts: Opaque) -> Array:
        """What `image` returned -> (N, 256) image tokens: the encoder's embedding, off by the vector of "no mask"."""

    def masks(
        self,
        parts: Opaque,
        asked: EmbeddedPrompts,
        least: float,
        first: int,
        size: tuple[int, int],
        soon: Callable[[], EmbeddedPrompts] | None = None,
    ) -> tuple[Rows, Array, Stack]:
        """The masks of B prompts. Those that are likely to be asked `soon`, in the same way, may be answered meanwhile.

        Returns the rows (b,) of the prompts with a predicted IoU of `least` or more, and the predicted IoU (b, M) and
        logits (b, M, height, width) of all their masks from the mask `first` (0..3) on. These are of `size` (height,
        width) px of a decoded mask; the padding beyond it is not decoded. A later call writes to none of these.
        """


def rows_of(parts: "Sequence[Tokens]", rows: Any) -> "list[Tokens]":
    """What `ImageNetwork` returns of each image token, of some of them."""
    keys, k, v, q, position = parts
    return [keys[rows], k[:, :, rows], v[:, rows], q[rows], position[rows]]


def promising(iou: Array, least: float) -> Rows:
    """Rows of prompts with a predicted IoU (B, M) of `least` or more."""
    return np.flatnonzero((iou >= least).any(1))


def of_photograph(tokens: Tokens, size: tuple[int, int]) -> Tokens:
    """Image tokens (B, N, C) -> those (B, h, w, C) under the first `size` (height, width) px of a decoded mask."""
    height, width = (-(-side // TOKEN_PX) for side in size)
    if tokens.shape[1] < GRID * GRID:  # thinned: those of the photograph are the first
        return tokens[:, : height * width].reshape(len(tokens), height, width, -1)
    return tokens.reshape(len(tokens), GRID, GRID, -1)[:, :height, :width]
