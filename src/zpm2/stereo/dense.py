"""A surface from a rectified pair alone: disparity by semi-global matching, or a given one, as a mesh.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 2008, as OpenCV has it.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from zpm2.errors import Failed, InputError
from zpm2.model import Image

Array = NDArray[np.float64]
Disparity = NDArray[np.float32]
CHECK = 1.0  # px by which the disparities of both images may differ
SPECKLE = 200  # px, smaller patches of disparity are noise
SMOOTH = 3.0  # px, standard deviation
TELLING, APART, AGREE = (
    30,
    5.0,
    0.25,
)  # points, px and share of points, from which a given map counts as that of the pair


def semi_global(left: Image, right: Image, low: int, high: int) -> Disparity:
    """(h, w) px, left x - right x, NaN where it is not known: SGBM over [low, high] px, both images' maps compared.

    Both photographs must have the same size.
    """
    count = -(-(high - low + 1) // 16) * 16
    grey = [cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    window = 5
    matcher: Any = cv2.StereoSGBM.create(
        minDisparity=low,
        numDisparities=count,
        blockSize=window,
        P1=8 * window**2,
        P2=32 * window**2,
        disp12MaxDiff=-1,
        preFilterCap=31,
        uniquenessRatio=5,
        mode=cv2.STEREO_SGBM_MODE_HH if grey[0].size < 4_000_000 else cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    maps = []
    for side in (0, 1):  # the right map: both images mirrored and exchanged
        a, b = (grey[0], grey[1]) if side == 0 else (grey[1][:, ::-1], grey[0][:, ::-1])
        border = ((0, 0), (max(0, low + count), max(0, -low)))  # columns at the border have a partner beyond it
        a, b = (np.pad(np.ascontiguousarray(x), border, mode="edge") for x in (a, b))
        found = matcher.compute(a, b)[:, border[1][0] : border[1][0] + grey[0].shape[1]].astype(np.float32)
        found[found < 16 * low] = np.nan
        maps.append(found / 16 if side == 0 else (found / 16)[:, ::-1])
    for found, image in zip(maps, (left, right), strict=True):
        if image.valid is not None:
            found[~image.valid] = np.nan
    disparity = _checked(maps[0], maps[1])
    whole = np.where(np.isfinite(disparity), disparity * 16, (low - 1) * 16).astype(np.int16)
    cv2.filterSpeckles(whole, (low - 1) * 16, SPECKLE, 16)
    disparity[whole == (low - 1) * 16] = np.nan
    return _smoothed(disparity)


def _smoothed(disparity: Disparity) -> Disparity:
    """Without the steps of whole pixels and the noise between them: a mean over `SMOOTH` px of what differs by a pixel
    or so (bilateral filter), so that edges stay."""
    known = np.isfinite(disparity)
    if not known.any():
        return disparity
    nearest: Any = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = np.ascontiguousarray(disparity[tuple(nearest)])
    return np.where(known, cv2.bilateralFilter(whole, 0, 1.0, SMOOTH), np.nan).astype(np.float32)


def _checked(left: Disparity, right: Disparity) -> Disparity:
    """The left map where the right one says the same."""
    height, width = left.shape
    x = np.arange(width)[None] + 0.5 - np.where(np.isfinite(left), left, 0)
    column = np.floor(x).astype(np.intp)
    inside = np.isfinite(left) & (column >= 0) & (column < width)
    other = right[np.arange(height)[:, None], np.clip(column, 0, width - 1)]
    with np.errstate(invalid="ignore"):
        return np.where(inside & (np.abs(left - other) <= CHECK), left, np.nan).astype(np.float32)


def disparity_range(differences: Array, width: int) -> tuple[int, int] | Failed:
    """[low, high] px of the search, from left x - right x of homologous points, a tenth wider on both sides."""
    if len(differences) < 8:
        return Failed(f"only {len(differences)} homologous points tell where to look for disparities")
    low, high = np.percentile(differences, [1, 99])
    margin = max(0.1 * (high - low), 8.0)
    low, high = int(np.floor(low - margin)), int(np.ceil(high + margin))
    if high - low > width / 2:
        return Failed(f"disparities from {low} to {high} px: this is no rectified pair")
    return low, high


def refuse_other_disparity(disparity: Disparity, left: Array, right: Array) -> None:
    """`InputError` for a map of the left image that homologous points, (n, 2) px each, contradict: of another scale or
    sign, or of depths."""
    row, column = np.floor(left[:, 1]).astype(np.intp), np.floor(left[:, 0]).astype(np.intp)
    there, seen = disparity[row, column], left[:, 0] - right[:, 0]
    there, seen = there[np.isfinite(there)], seen[np.isfinite(there)]
    if len(there) < TELLING or (np.abs(there - seen) < APART).mean() > AGREE:
        return
    raise InputError(
        f"the disparity map does not fit the matches: it has {np.median(there):.1f} px where they have "
        f"{np.median(seen):.1f} (medians); give its scale and sign, and a map of disparities, not of depths"
    )
