"""Grey values between pixels, and image pyramids."""

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.model import Image

_LEVELS = threading.Lock()  # several threads sample one photograph


def pyramid(gray: NDArray[np.float32], levels: int, factor: int) -> list[NDArray[np.float32]]:
    """Gaussian pyramid, full resolution first. Level k is `factor` times smaller than level k - 1 and keeps the
    outer-corner origin: a point p of level 0 is p / factor^k."""
    result = [gray]
    for _ in range(levels):
        h, w = result[-1].shape
        blurred = cv2.GaussianBlur(result[-1], (0, 0), 0.5 * factor)
        to_fine = np.array([[factor, 0, (factor - 1) / 2], [0, factor, (factor - 1) / 2]], np.float64)
        size = (max(1, -(-w // factor)), max(1, -(-h // factor)))
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        result.append(np.asarray(cv2.warpAffine(blurred, to_fine, size, flags=how, borderMode=cv2.BORDER_REPLICATE)))
    return result


def levels(image: Image, count: int, factor: int) -> list[NDArray[np.float32]]:
    """The `pyramid` of a photograph, of at least `count` levels beyond the full one. Each level is computed once."""
    with _LEVELS:
        known = image.levels.get(factor, [image.gray])
        if len(known) <= count:
            known = [*known[:-1], *pyramid(known[-1], count + 1 - len(known), factor)]
            image.levels[factor] = known
        return known


def bilinear(image: NDArray[np.float32], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
    """Interpolated values at columns `x` and rows `y`, px with centres at 0; the border's beyond it.

    `x` and `y` broadcast to the shape of the result. Where they are those of a grid, let them do so: most of the work
    is then done once for each column and row.
    """
    h, w = image.shape
    x, y = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    x0, y0 = np.minimum(x.astype(np.int64), max(w - 2, 0)), np.minimum(y.astype(np.int64), max(h - 2, 0))
    fx, fy = (x - x0).astype(np.float32), (y - y0).astype(np.float32)
    pixels, at_pixel = image.ravel(), y0 * w + x0  # by one index, which is faster than by two
    right, down = min(w - 1, 1), w * min(h - 1, 1)  # x0 + 1 < w and y0 + 1 < h but in images of one pixel
    top = pixels.take(at_pixel) * (1 - fx) + pixels.take(at_pixel + right) * fx
    at_pixel += down
    bottom = pixels.take(at_pixel) * (1 - fx) + pixels.take(at_pixel + right) * fx
    return np.asarray(top * (1 - fy) + bottom * fy, np.float32)
