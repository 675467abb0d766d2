"""Disparity of a rectified pair: the methods, semi-global matching, and where to search.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 2008, as OpenCV has it.
"""

import functools
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import StereoConfig
from zpm2.errors import Failed, InputError
from zpm2.model import Image
from zpm2.runtime import resolve_device
from zpm2.stereo.refine import SUBPIXEL, Disparity, refined, refuse_far

Array = NDArray[np.float64]
# A given map is that of another pair or scale, where of so many points fewer than this share lie within so many px.
FOREIGN_MAP_POINTS, FOREIGN_MAP_PX, FOREIGN_MAP_SHARE = 30, 5.0, 0.25


class StereoMatcher(Protocol):
    """A dense stereo method."""

    def __call__(self, left: Image, right: Image, low: int, high: int) -> Disparity:
        """(h, w) px, left x - right x of two rectified images of one size, searched over [low, high] px; NaN where it
        is not known. `InputError` where that takes more memory than there is."""


def stereo_matcher(config: StereoConfig, device: str) -> StereoMatcher:
    """The method that `stereo.method` names. `MissingDependency` without libsgm, `WeightsError` without weights."""
    if config.method == "sgbm":
        return functools.partial(semi_global, config=config)
    from zpm2.stereo.mc_cnn import McCnn

    return McCnn(config, resolve_device(device))


def semi_global(left: Image, right: Image, low: int, high: int, config: StereoConfig) -> Disparity:
    """(h, w) px, left x - right x, NaN where it is not known: SGBM over [low, high] px, both images' maps compared.

    Both photographs must have the same size.
    """
    refuse_far(low, high)
    count = -(-(high - low + 1) // SUBPIXEL) * SUBPIXEL
    grey = [cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    small = grey[0].size < config.all_directions
    matcher = cv2.StereoSGBM.create(
        minDisparity=low,
        numDisparities=count,
        blockSize=config.window,
        P1=config.small_step * config.window**2,
        P2=config.large_step * config.window**2,
        disp12MaxDiff=-1,  # both maps are compared here, of the whole images
        preFilterCap=config.prefilter,
        uniquenessRatio=config.uniqueness,
        mode=cv2.STEREO_SGBM_MODE_HH if small else cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    maps = []
    for side in (0, 1):  # the right map: both images mirrored and exchanged
        a, b = (grey[0], grey[1]) if side == 0 else (grey[1][:, ::-1], grey[0][:, ::-1])
        border = ((0, 0), (max(0, low + count), max(0, -low)))  # columns at the border have a partner beyond it
        a, b = (np.pad(np.ascontiguousarray(x), border, mode="edge") for x in (a, b))
        found = matcher.compute(a, b)[:, border[1][0] : border[1][0] + grey[0].shape[1]].astype(np.float32)
        found[found < SUBPIXEL * low] = np.nan
        maps.append(found / SUBPIXEL if side == 0 else (found / SUBPIXEL)[:, ::-1])
    return refined(maps, (left, right), low, config)


def robust_range(disparities: Array, margin: float, config: StereoConfig) -> tuple[float, float, float]:
    """px: least and greatest of (n,) disparities without outliers, and by how much to search beyond them."""
    low, high = np.percentile(disparities, [100 * config.outliers, 100 - 100 * config.outliers])
    return float(low), float(high), max(margin * float(high - low), config.min_range_margin)


def disparity_range(differences: Array, width: int, config: StereoConfig) -> tuple[int, int] | Failed:
    """[low, high] px of the search, from left x - right x of homologous points in images of `width` px."""
    if len(differences) < config.min_range_points:
        return Failed(f"only {len(differences)} homologous points show which disparities to search")
    near, far, margin = robust_range(differences, config.range_margin, config)
    low, high = int(np.floor(near - margin)), int(np.ceil(far + margin))
    if high - low > config.max_range * width:
        return Failed(f"disparities from {low} to {high} px: this is not a rectified pair")
    return low, high


def refuse_other_disparity(disparity: Disparity, left: Array, right: Array) -> None:
    """`InputError` for a map of the left image that homologous points, (n, 2) px each, contradict: of another scale or
    sign, or of depths."""
    row, column = np.floor(left[:, 1]).astype(np.intp), np.floor(left[:, 0]).astype(np.intp)
    there, seen = disparity[row, column], left[:, 0] - right[:, 0]
    there, seen = there[np.isfinite(there)], seen[np.isfinite(there)]
    if len(there) < FOREIGN_MAP_POINTS or (np.abs(there - seen) < FOREIGN_MAP_PX).mean() > FOREIGN_MAP_SHARE:
        return
    raise InputError(
        f"the disparity map does not fit the matches: it has {np.median(there):.1f} px where they have "
        f"{np.median(seen):.1f} (medians); give its scale and sign, and a map of disparities, not of depths"
    )
