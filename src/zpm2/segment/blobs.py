"""Blobs: where a photograph differs from its surroundings, at several scales. The first prompts are made there."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import PromptConfig
from zpm2.model import Image

DISC_RADIUS = 1.4  # sigmas: of the disc on which a difference of Gaussians has its largest response


@dataclass(frozen=True, eq=False)
class Blobs:
    """n blobs, the most contrasted first."""

    points: NDArray[np.float64]  # (n, 2) px of a decoded mask
    area: NDArray[np.float64]  # (n,) px^2, of a disc of the blob's scale

    def __len__(self) -> int:
        return len(self.points)


def blobs(image: Image, valid: NDArray[np.bool_], config: PromptConfig) -> Blobs:
    """Blobs by differences of Gaussians (Lindeberg 1998), in colour: local maxima of the distance in CIELAB between the
    photograph under a Gaussian and under one twice as wide.

    The photograph is reduced to the (height, width) of a decoded mask, the shape of `valid` (`has_data`). Pixels
    without data, and their neighbours, hold no blobs.
    """
    height, width = valid.shape
    small = cv2.resize(image.rgb, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    lab = cv2.cvtColor(small, cv2.COLOR_RGB2LAB)
    holds = valid.astype(np.uint8)
    points, area, contrast = [], [], []
    for sigma in config.blob_sigmas:
        difference = cv2.GaussianBlur(lab, (0, 0), sigma) - cv2.GaussianBlur(lab, (0, 0), 2 * sigma)
        strength = np.linalg.norm(difference, axis=2)
        side = 2 * round(config.blob_distance * sigma) + 1
        window = np.ones((side, side), np.uint8)
        peak = (strength == cv2.dilate(strength, window)) & (strength >= config.min_blob_contrast)
        row, column = np.nonzero(peak & (cv2.erode(holds, window) > 0))
        points.append(np.c_[column, row] + 0.5)
        area.append(np.full(len(row), np.pi * (DISC_RADIUS * sigma) ** 2))
        contrast.append(strength[row, column])
    order = np.argsort(-np.concatenate(contrast), kind="stable")
    return Blobs(np.concatenate(points)[order], np.concatenate(area)[order])


def has_data(image: Image, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(height, width) of a decoded mask: where the photograph holds data."""
    if image.valid is None:
        return np.ones(size, bool)
    return cv2.resize(image.valid.astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST) > 0
