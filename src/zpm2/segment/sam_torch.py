"""SAM's three networks in torch, on a CPU or a GPU."""

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zpm2.segment import stacks
from zpm2.segment.sam_backend import Array, EmbeddedPrompts, of_photograph, promising, rows_of
from zpm2.segment.sam_input import ENCODER_SIDE, MEAN, STD
from zpm2.segment.sam_padding import ThinnedTokens
from zpm2.segment.sam_vicinity import NearTokens
from zpm2.segment.stacks import Rows, Stack

if TYPE_CHECKING:
    from torch import Tensor


class TorchBackend:
    """The networks in torch. Where they run on a GPU (`resident`), masks and what belongs to them stay there.

    `precision` is that of the prompt and the mask network.
    """

    name = "torch"

    def __init__(self, model: str, batch: int, device: str, precision: str = "float32") -> None:
        import torch

        from zpm2.segment import sam_network
        from zpm2.segment.device_stacks import to_host

        self.to_host = to_host
        self.torch, self.device, self.dtype = torch, torch.device(device), getattr(torch, precision)
        self.batch, self.resident = batch, self.device.type != "cpu"
        sam = sam_network.load_sam(model)
        self.embed = sam_network.PromptEmbedding.of(sam)
        self.encoder = sam_network.ImageNetwork(sam).eval().to(self.device)
        if precision != "float32":  # layers that two networks share stay single in the encoder
            sam.mask_decoder = deepcopy(sam.mask_decoder)
        self.prompter = sam_network.PromptNetwork(sam).eval().to(self.device, self.dtype)
        self.decoder = sam_network.MaskNetwork(sam).eval().to(self.device, self.dtype)

    def _to(self, array: NDArray[np.generic]) -> "Tensor":
        from zpm2.segment.device_stacks import on

        return on(array, self.device)

    def _out(self, tensor: "Tensor") -> Stack:
        return tensor if self.resident else tensor.float().numpy()

    def image(self, pixels: Array) -> "tuple[Tensor, ...]":
        with self.torch.inference_mode():
            return self._in_half(self.encoder(self._to(pixels)))

    def images(self, reduced: Sequence[NDArray[np.uint8]]) -> "list[tuple[Tensor, ...]]":
        """`image` of several photographs (h, w, 3), reduced to fit the square, in one batch."""
        with self.torch.inference_mode():
            squares = self.torch.zeros(len(reduced), 3, ENCODER_SIDE, ENCODER_SIDE, device=self.device)
            mean, std = self._to(MEAN), self._to(STD)
            for square, rgb in zip(squares, reduced, strict=True):
                normal = (self._to(rgb).float() - mean) / std
                square[:, : rgb.shape[0], : rgb.shape[1]] = normal.permute(2, 0, 1)
            return [self._in_half(self.encoder.parts(each)) for each in self.encoder.encoder(squares)]

    def _in_half(self, parts: "tuple[Tensor, ...]") -> "tuple[Tensor, ...]":
        return tuple(part.to(self.dtype) for part in parts)

    def thinned(self, parts: "tuple[Tensor, ...]", tokens: ThinnedTokens) -> "tuple[Tensor, ...]":
        counts = self._to(tokens.log_count).to(self.dtype)
        return *(part.contiguous() for part in rows_of(parts[:-1], self._to(tokens.rows))), counts

    def tokens(self, parts: "tuple[Tensor, ...]") -> Array:
        return np.asarray(parts[0].float().cpu().numpy())

    def masks(
        self,
        parts: "tuple[Tensor, ...]",
        asked: EmbeddedPrompts,
        least: float,
        first: int,
        size: tuple[int, int],
        soon: Callable[[], EmbeddedPrompts] | None = None,
    ) -> tuple[Rows, Array, Stack]:
        iou, hyper, tokens = self.prompt(parts, asked.sparse, asked.near)
        iou, hyper = iou[:, first:], hyper[:, first:]
        rows = promising(iou, least)
        if not len(rows):
            return rows, iou[rows], np.zeros((0, iou.shape[1], *size), np.float32)
        return rows, iou[rows], self.mask(tokens, rows, stacks.take(hyper, rows), size)

    def prompt(
        self, parts: "tuple[Tensor, ...]", sparse: Array, near: NearTokens | None = None
    ) -> "tuple[Array, Stack, Tensor]":
        """Embedded prompts (B, P, 256) -> predicted IoU (B, 4), mask weights (B, 4, 32), image tokens."""
        with self.torch.inference_mode():
            if near is not None:
                keys, k, v, *others = rows_of(parts[:-1], self._to(near.rows))
                counts = self._to(near.log_count).to(self.dtype)
                parts = (keys, k.permute(2, 0, 1, 3), v.permute(1, 0, 2, 3), *others, counts)
            iou, hyper, tokens = self.prompter(*parts, self._to(sparse).to(self.dtype))
            return np.asarray(self.to_host(iou.float())[0], np.float32), self._out(hyper), tokens

    def mask(self, tokens: "Tensor", rows: NDArray[np.intp], hyper: Stack, size: tuple[int, int]) -> Stack:
        """Image tokens of the prompts `rows` and their mask weights (b, M, 32) -> logits (b, M, height, width)."""
        weights = self._to(hyper).to(self.dtype) if isinstance(hyper, np.ndarray) else hyper
        with self.torch.inference_mode():
            logits = self.decoder(of_photograph(tokens[self._to(rows)], size), weights)
        return self._out(logits[:, :, : size[0], : size[1]])
