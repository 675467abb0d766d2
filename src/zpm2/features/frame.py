"""From an image to a network's input, and from the network's pixels back to image coordinates."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from zpm2.config import PointsConfig
from zpm2.model import Image

LUMA = (0.299, 0.587, 0.114)  # ITU-R BT.601
STRIDE = 32  # px: sides are multiples of it, as XFeat and ALIKED need; DISK needs 16, SuperPoint 8


@dataclass(frozen=True, eq=False)
class Frame:
    """An image resized for a network: each side by its own exact factor, then padded to the right and below."""

    pixels: torch.Tensor  # (1, 3, h, w) float32 RGB 0..1, sides multiples of `STRIDE`
    scale: NDArray[np.float64]  # (2,) network px per original px, along x and y
    size: tuple[int, int]  # (width, height) of the original image, px
    useful: torch.Tensor  # (h, w) bool: pixels of the image, not of its padding, with some contrast around them

    def to_image(self, points: torch.Tensor) -> NDArray[np.float64]:
        """(n, 2) network px with pixel centres at 0 -> (n, 2) original px with pixel centres at +0.5."""
        return np.asarray((points.cpu().numpy().astype(np.float64) + 0.5) / self.scale)

    def is_useful(self, points: torch.Tensor) -> torch.Tensor:
        """(n,) bool: which of (n, 2) network px, centres at 0, lie on useful pixels.

        Networks also report points where there is nothing to see: on padding, a blank wall, no data, a burnt-out sky.
        """
        x, y = torch.floor(points + 0.5).long().T
        height, width = self.useful.shape
        useful: torch.Tensor = self.useful[y.clamp(0, height - 1), x.clamp(0, width - 1)]
        return useful.logical_and((x >= 0) & (x < width) & (y >= 0) & (y < height))


def frame(image: Image, config: PointsConfig, device: str, zoom: float = 1.0) -> Frame:
    """`image` with its longer side at most `config.max_size` px, never enlarged; then times `zoom`.

    Both sides are rounded to whole pixels, so the factors of x and y differ by less than half a pixel over the image.
    The padding repeats the border, so that no edge appears there.
    """
    factor = min(1.0, config.max_size / max(image.width, image.height)) * zoom
    width, height = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    rgb = image.rgb
    if (width, height) != (image.width, image.height):
        how = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
        rgb = cv2.resize(rgb, (width, height), interpolation=how)
    useful = _has_contrast(rgb, config)
    below, right = -height % STRIDE, -width % STRIDE
    rgb = cv2.copyMakeBorder(rgb, 0, below, 0, right, cv2.BORDER_REPLICATE)
    pixels = torch.from_numpy(rgb).to(device).permute(2, 0, 1)[None].float() / 255.0
    scale = np.array([width / image.width, height / image.height])
    return Frame(
        pixels,
        scale,
        (image.width, image.height),
        torch.from_numpy(np.pad(useful, ((0, below), (0, right)))).to(device),
    )


def gray(pixels: torch.Tensor) -> torch.Tensor:
    """(b, 3, h, w) RGB -> (b, 1, h, w), for networks that see grey values."""
    return (pixels * torch.tensor(LUMA, device=pixels.device).view(1, 3, 1, 1)).sum(1, keepdim=True)


def padded_alike(left: torch.Tensor, right: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Both (b, c, h, w) as large as the larger one, to the right and below, for networks that take pairs of one size.
    The padding repeats the border."""
    height, width = (max(left.shape[k], right.shape[k]) for k in (2, 3))
    pad = torch.nn.functional.pad
    a, b = (pad(each, (0, width - each.shape[3], 0, height - each.shape[2]), "replicate") for each in (left, right))
    return a, b


def _has_contrast(rgb: NDArray[np.uint8], config: PointsConfig) -> NDArray[np.bool_]:
    """(h, w) where some channel of (h, w, 3) varies by more than `config.blank_range` within `config.blank_window`."""
    window = np.ones((config.blank_window, config.blank_window), np.uint8)
    return np.asarray((cv2.dilate(rgb, window) - cv2.erode(rgb, window)).max(2) > config.blank_range)
