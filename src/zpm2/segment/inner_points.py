"""Points inside a mask, to ask a segmenter by."""

import cv2
import numpy as np
from numpy.typing import NDArray


def inner_points(bits: NDArray[np.bool_], most: int) -> NDArray[np.float64]:
    """(k, 2) x, y of up to `most` pixel centres inside `bits` (h, w), px from its first corner.

    The first is the pixel farthest from the outline. Each other one is far from those before it, and from the outline
    by at least half of that: it maximises the lesser of the distance to them and twice the distance to the outline. So
    they follow the parts of thin and bent shapes. Of equal pixels, the first one row by row. There are fewer than
    `most` where no other pixel is left.
    """
    squared = squared_depth(np.pad(bits, 1))
    apart = value = squared
    found = list[tuple[float, float]]()
    while len(found) < most and value.any():
        y, x = np.unravel_index(np.argmax(value), squared.shape)
        to_it = (np.arange(squared.shape[0]) - y)[:, None] ** 2 + (np.arange(squared.shape[1]) - x) ** 2
        apart = np.minimum(apart, to_it) if found else to_it
        value = np.minimum(apart, 4 * squared)
        found.append((x - 0.5, y - 0.5))
    return np.array(found, np.float64).reshape(-1, 2)


def squared_depth(bits: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(h, w) px^2 from each pixel of `bits` (h, w) to the nearest one that is not of them: whole numbers, as OpenCV's
    last bits depend on where the array lies in memory."""
    depth = cv2.distanceTransform(bits.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.rint(depth**2))
