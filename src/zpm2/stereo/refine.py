"""What is kept of the disparities that a search found, whatever it compared."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from zpm2.config import StereoConfig
from zpm2.errors import InputError
from zpm2.model import Image

Disparity = NDArray[np.float32]
SUBPIXEL = 16  # OpenCV's disparities are in 1/16 px, and searched in groups of 16
FAR = 2000  # px, beyond which disparities in 1/16 px do not fit into 16 bits


def refuse_far(low: int, high: int) -> None:
    """`InputError` for disparities that are not searched."""
    if min(low, high) < -FAR or max(low, high) > FAR:
        raise InputError(f"disparities from {low} to {high} px: at most {FAR} px are searched; reduce the photographs")


def refined(maps: Sequence[Disparity], images: Sequence[Image], low: int, config: StereoConfig) -> Disparity:
    """(h, w) px of the left image, NaN where it is not known, from the raw maps of both images, (h, w) px of at least
    `low` each: where both agree and both photographs have data, without small patches, smoothed. Changes the maps."""
    for found, image in zip(maps, images, strict=True):
        if image.valid is not None:
            found[~image.valid] = np.nan
    disparity = _consistent(maps[0], maps[1], config.left_right)
    unknown = (low - 1) * SUBPIXEL
    whole = np.where(np.isfinite(disparity), disparity * SUBPIXEL, unknown).astype(np.int16)
    cv2.filterSpeckles(whole, unknown, config.speckle, SUBPIXEL)
    disparity[whole == unknown] = np.nan
    return _smoothed(disparity, config)


def _smoothed(disparity: Disparity, config: StereoConfig) -> Disparity:
    """Without the steps of whole pixels and the noise between them. The filter is bilateral: it averages disparities
    that differ by a pixel or so, and edges stay."""
    known = np.isfinite(disparity)
    if not known.any():
        return disparity
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = np.ascontiguousarray(disparity[tuple(nearest)])
    smooth = cv2.bilateralFilter(whole, 0, config.smooth_range, config.smooth)
    return np.where(known, smooth, np.nan).astype(np.float32)


def _consistent(left: Disparity, right: Disparity, tolerance: float) -> Disparity:
    """The left map where the right one agrees within `tolerance` px."""
    height, width = left.shape
    x = np.arange(width)[None] + 0.5 - np.where(np.isfinite(left), left, 0)
    column = np.floor(x).astype(np.intp)
    inside = np.isfinite(left) & (column >= 0) & (column < width)
    other = right[np.arange(height)[:, None], np.clip(column, 0, width - 1)]
    with np.errstate(invalid="ignore"):
        return np.where(inside & (np.abs(left - other) <= tolerance), left, np.nan).astype(np.float32)
