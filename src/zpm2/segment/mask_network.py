"""Promptable networks that come whole: an image is encoded once, and prompts in batches give masks with scores.

SAM 2 and its relatives run like this, each with one file in `methods`. (`sam` is the first SAM, cut into pieces of its
own for speed.) A network says how it wants to see a photograph (`Sight`); all else is here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.model import Image, Mask
from zpm2.segment import automatic, stacks
from zpm2.segment.mask_view import NETWORK_LOCK, MaskView, Room, predicted, settled
from zpm2.segment.predictions import MASK_SIDE, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam_input import MEAN, STD
from zpm2.segment.stacks import Stack

Array = NDArray[np.float32]
Encoded = TypeVar("Encoded")  # what a network makes of a photograph, and only it reads


@dataclass(frozen=True)
class Sight:
    """How a network sees a photograph: in a square, of which R, G and B (0..255) are normalised."""

    side: int  # px of the square
    stretched: bool  # over the whole square; else in its upper left corner at its own proportions, over zeros
    mean: tuple[float, float, float] = (float(MEAN[0]), float(MEAN[1]), float(MEAN[2]))
    std: tuple[float, float, float] = (float(STD[0]), float(STD[1]), float(STD[2]))

    def scale(self, image: Image) -> NDArray[np.float64]:
        """(2,) px of the square per image px, along x and y."""
        size = np.array([image.width, image.height], float)
        return self.side / (size if self.stretched else np.full(2, size.max()))

    def pixels(self, image: Image) -> Array:
        """(1, 3, side, side) the photograph as the network takes it."""
        scale = self.scale(image)
        w, h = np.clip(np.round(scale * [image.width, image.height]).astype(int), 1, self.side)
        how = cv2.INTER_AREA if scale.min() < 1 else cv2.INTER_LINEAR
        small = cv2.resize(image.rgb, (int(w), int(h)), interpolation=how).astype(np.float32)
        square = np.zeros((1, 3, self.side, self.side), np.float32)
        square[0, :, :h, :w] = (
            (small - np.asarray(self.mean, np.float32)) / np.asarray(self.std, np.float32)
        ).transpose(2, 0, 1)
        return square


class MaskNetwork(Protocol[Encoded]):
    """An image encoder, and a decoder of prompts into masks."""

    sight: Sight
    batch: int  # prompts at a time, at most

    def encode(self, pixels: Array) -> Encoded:
        """(1, 3, side, side) -> what `decode` needs of the photograph."""

    def decode(self, encoded: Encoded, points: Array, labels: NDArray[np.int64]) -> tuple[Array, Stack]:
        """Prompts as points (B, P, 2), px of the square from its outer corner, with labels (P,) as in `predictions` ->
        predicted IoU (B, M), 0..1, and logits (B, M, m, m) over the whole square."""


class NetworkView(MaskView, Generic[Encoded]):
    """One photograph as a `MaskNetwork` sees it, encoded once. Implements `PromptedView`."""

    def __init__(
        self, network: MaskNetwork[Encoded], image: Image, config: SegmentConfig, room: Room | None = None
    ) -> None:
        super().__init__(image, network.sight.side)
        self.network, self.config, self.batch = network, config, network.batch
        self.room = room or Room(network.batch, [])  # of all views of the network
        self.scale = network.sight.scale(image)
        with NETWORK_LOCK:
            self.encoded = network.encode(network.sight.pixels(image))

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`."""

        def predict(rows: slice, _: slice) -> MaskPredictions:
            return self._predict_batch(prompts[rows], rows.start, thresholds)

        return MaskPredictions.join(predicted(prompts, self.room, predict, self.size))

    def _predict_batch(self, prompts: Prompts, start: int, thresholds: MaskThresholds) -> MaskPredictions:
        points = np.asarray(prompts.points * self.scale, np.float32)
        with NETWORK_LOCK:
            iou, squares = self.network.decode(self.encoded, points, prompts.labels)
        good = iou >= thresholds.predicted_iou
        if not good.any():
            return MaskPredictions.none(self.size)
        prompt = start + np.nonzero(good)[0]
        flat = stacks.take(squares.reshape(-1, *squares.shape[2:]), np.flatnonzero(good))
        return settled(prompt, iou[good], self._in_proportion(flat), self.config.stability_offset, thresholds)

    def _in_proportion(self, squares: Stack) -> Stack:
        """(n, m, m) logits over the square -> (n, height, width) of the photograph in its own proportions."""
        height, width = self.size
        if squares.shape[1] == MASK_SIDE and np.allclose(self.scale, self.scale.max()):
            part = squares[:, :height, :width]
            return np.ascontiguousarray(part) if isinstance(part, np.ndarray) else part
        x, y = self.scale / self.mask_scale * squares.shape[1] / self.network.sight.side  # their px per px of ours
        if not isinstance(squares, np.ndarray):
            from zpm2.segment import device_stacks

            return device_stacks.resampled(squares, float(x), float(y), self.size)
        to_square = np.array([[x, 0, x / 2 - 0.5], [0, y, y / 2 - 0.5]])
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        each = (
            cv2.warpAffine(square, to_square, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE)
            for square in squares
        )
        return np.stack([np.asarray(logits, np.float32) for logits in each])


class NetworkSegmenter(Generic[Encoded]):
    """A `MaskNetwork` behind the `PromptedSegmenter` protocol.

    `notes` tell the user how it runs. `progress` receives the share of an image's prompts that is done, 0..1.
    """

    def __init__(
        self,
        name: str,
        config: SegmentConfig,
        network: MaskNetwork[Encoded],
        notes: Sequence[str] = (),
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        self.name, self.config, self.network = name, config, network
        self.notes, self.progress = list(notes), progress
        self._room = Room(network.batch, self.notes)

    def view(self, image: Image) -> NetworkView[Encoded]:
        """The photograph, encoded."""
        return NetworkView(self.network, image, self.config, self._room)

    def segment(self, image: Image) -> list[Mask]:
        """The regions, best score first."""
        return automatic.regions(self.view(image), self.config, self.progress)
