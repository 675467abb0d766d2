"""A photograph as SAM's encoder takes it: in a square of 1024 px, normalised."""

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.model import Image

ENCODER_SIDE = 1024  # px, the square that the image encoder sees
# of ImageNet's R, G and B in 0..255, which the released networks were trained with
MEAN = np.array([123.675, 116.28, 103.53], np.float32)
STD = np.array([58.395, 57.12, 57.375], np.float32)


def reduced(image: Image, scale: float) -> NDArray[np.uint8]:
    """(h, w, 3) the image resized by `scale`, so that it fits the square."""
    w, h = min(ENCODER_SIDE, max(1, round(image.width * scale))), min(ENCODER_SIDE, max(1, round(image.height * scale)))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image.rgb, (w, h), interpolation=how), np.uint8)


def encoder_input(image: Image, scale: float) -> NDArray[np.float32]:
    """(1, 3, 1024, 1024): the image resized by `scale`, normalised, padded with zeros at the right and bottom."""
    small = reduced(image, scale).astype(np.float32)
    square = np.zeros((1, 3, ENCODER_SIDE, ENCODER_SIDE), np.float32)
    square[0, :, : small.shape[0], : small.shape[1]] = ((small - MEAN) / STD).transpose(2, 0, 1)
    return square
