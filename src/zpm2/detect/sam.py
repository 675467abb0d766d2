"""Segment everything with SAM: a grid of point prompts, filters, and one mask per region.

The procedure is SAM's automatic mask generator (Kirillov et al. 2023, Appendix B, "Automatic Mask Generation"), on one
view of the image. All filters work at the decoder's 256 x 256 resolution; only what survives them is brought to the
image's own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.detect import masks
from zpm2.detect.sam_backend import SamBackend, open_backend
from zpm2.model import Image, Mask

SIDE, LOW = 1024, 256  # px, what the image encoder sees and what the mask decoder answers
BATCH = 16  # prompts at a time: 4 MB of image tokens each
MEAN = np.array([123.675, 116.28, 103.53], np.float32)
STD = np.array([58.395, 57.12, 57.375], np.float32)


@dataclass(frozen=True, eq=False)
class _Found:
    """Masks that passed the filters, at low resolution."""

    score: NDArray[np.float32]  # (n,) predicted IoU
    logits: NDArray[np.float16]  # (n, 256, 256)

    @staticmethod
    def join(parts: "list[_Found]") -> "_Found":
        return _Found(np.concatenate([p.score for p in parts]), np.concatenate([p.logits for p in parts]))


class SamSegmenter:
    """SAM behind the `Segmenter` protocol. Loads its networks on first use and keeps them.

    `notes` holds what a user should know about how it runs. `say` is told about a conversion in progress,
    `progress` the share of an image's prompts that is done, 0..1, and `download` the bytes of missing weights.
    """

    def __init__(
        self,
        config: SegmentConfig,
        device: str = "cpu",
        say: Callable[[str], None] = lambda _: None,
        progress: Callable[[float], None] = lambda _: None,
        download: weights.Progress = lambda done, total: None,
    ) -> None:
        self.config, self.device = config, device
        self.say, self.progress, self.download = say, progress, download
        self.name: str = config.model
        self.notes: list[str] = []
        self._backend: SamBackend | None = None

    def load(self) -> SamBackend:
        """The networks, loaded (and converted, once per machine) when first asked for."""
        if self._backend is None:
            self._backend = open_backend(self.config.model, self.config.backend, self.device, self.say, self.download)
            if self.config.backend == "auto" and self.device == "cpu" and self._backend.name == "torch":
                self.notes.append("openvino is not installed, the segmenter runs in torch: pip install openvino")
        return self._backend

    def segment(self, image: Image) -> list[Mask]:
        """Every region that the prompts find, best score first."""
        backend, scale = self.load(), SIDE / max(image.width, image.height)
        parts = backend.image(encoder_input(image, scale))
        grid = (np.arange(self.config.grid) + 0.5) / self.config.grid
        x, y = np.meshgrid(grid * image.width * scale, grid * image.height * scale)
        prompts = np.c_[x.ravel(), y.ravel()][:, None]
        valid = np.ceil(np.array([image.height, image.width]) * scale * LOW / SIDE).astype(int)
        found = []
        for start in range(0, len(prompts), BATCH):
            found.append(self._decode(backend, parts, prompts[start : start + BATCH], valid))
            self.progress(min(1.0, (start + BATCH) / len(prompts)))
        return self._finish(_Found.join(found), image, scale)

    def _decode(self, backend: SamBackend, parts: Any, points: NDArray[np.float64], valid: NDArray[np.int64]) -> _Found:
        """One batch of point prompts (B, 1, 2), px of the encoder's square -> the masks that pass the filters."""
        config = self.config
        iou, hyper, tokens = backend.prompt(parts, backend.embed(points, np.array([1])))
        iou, hyper = iou[:, 1:], hyper[:, 1:]  # the first mask is the single-mask answer, for several prompts at once
        rows = np.flatnonzero((iou >= config.min_predicted_iou).any(1))
        if len(rows) == 0:
            return _Found(np.zeros(0, np.float32), np.zeros((0, LOW, LOW), np.float16))
        logits = backend.mask(tokens, rows, hyper[rows])
        good = iou[rows] >= config.min_predicted_iou
        logits, score = logits[good], iou[rows][good]
        logits[:, valid[0] :] = logits[:, :, valid[1] :] = -np.inf  # the padding is no part of the image
        inner = (logits > config.stability_offset).sum((1, 2))
        outer = (logits > -config.stability_offset).sum((1, 2))
        stable = inner >= np.maximum(config.min_stability * outer, 1)
        return _Found(score[stable], np.clip(logits[stable], -60, 60).astype(np.float16))

    def _finish(self, found: _Found, image: Image, scale: float) -> list[Mask]:
        pixels = (SIDE / LOW / scale) ** 2  # image px^2 of one low-resolution pixel
        bits = found.logits > 0
        area = bits.sum((1, 2), dtype=np.int64)
        usable = (area * pixels >= self.config.min_area / 2) & (area > 0)
        usable &= area * pixels <= self.config.max_area * image.width * image.height
        score, logits, bits, area = found.score[usable], found.logits[usable], bits[usable], area[usable]
        if len(score) == 0:
            return []
        box = masks.boxes(bits)
        keep = masks.suppress(masks.pack(bits), box, area, score, self.config.nms_iou)
        found_masks = (upsample(logits[k], box[k], image, scale, float(min(score[k], 1.0))) for k in keep)
        return [mask for mask in found_masks if mask.area >= self.config.min_area]


def encoder_input(image: Image, scale: float) -> NDArray[np.float32]:
    """(1, 3, 1024, 1024): the image resized by `scale`, normalised, padded with zeros at the right and bottom."""
    w, h = min(SIDE, max(1, round(image.width * scale))), min(SIDE, max(1, round(image.height * scale)))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image.rgb, (w, h), interpolation=how).astype(np.float32)
    square = np.zeros((1, 3, SIDE, SIDE), np.float32)
    square[0, :, :h, :w] = ((small - MEAN) / STD).transpose(2, 0, 1)
    return square


def upsample(logits: NDArray[np.float16], box: NDArray[np.int64], image: Image, scale: float, score: float) -> Mask:
    """A 256 x 256 mask at the image's resolution: bilinear logits cut at 0, in the box (x0, y0, x1, y1)."""
    size = SIDE / LOW / scale  # image px of one low-resolution pixel
    x0, y0 = np.maximum(np.floor((box[:2] - 1) * size).astype(int), 0)
    x1, y1 = np.minimum(np.ceil((box[2:] + 1) * size).astype(int), [image.width, image.height])
    if x1 <= x0 or y1 <= y0:
        return Mask(0, 0, np.zeros((1, 1), bool), score)
    to_low = np.array([[1 / size, 0, (x0 + 0.5) / size - 0.5], [0, 1 / size, (y0 + 0.5) / size - 0.5]])
    fine = cv2.warpAffine(
        logits.astype(np.float32),
        to_low,
        (int(x1 - x0), int(y1 - y0)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return Mask(int(x0), int(y0), fine > 0, score)
