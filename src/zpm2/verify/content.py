"""Do two polygons show the same? Their insides are compared where their outlines say that they lie, and beside it.

The left photograph is rectified by an affine map that brings one outline onto the other: the place and the size do not
come from homologous points. The inside of the polygon then correlates best without a shift. If another shift does as
well, the texture repeats, or the outline belongs to something in front (a door seen through a fence) and the content
moved behind it.
"""

import cv2
import numpy as np
import scipy.fft
import shapely
from numpy.typing import NDArray

from zpm2.config import VerifyConfig
from zpm2.cores import in_chunks
from zpm2.local_match.texture import covered, sampled, together
from zpm2.model import Image

Array = NDArray[np.float64]
Patches = NDArray[np.float32]  # (k, size, size)
Bits = NDArray[np.bool_]
CHANNELS = 64  # patches at a time, of the 128 that OpenCV takes as channels of one image


def peaks(
    images: tuple[Image, Image],
    warped: NDArray[np.object_],
    right: NDArray[np.object_],
    maps: Array,
    config: VerifyConfig,
    max_halvings: int,
) -> Array:
    """(k,) -2..2: the correlation of the insides of both polygons where they are, less what other shifts reach.

    `warped` (k,) are the left polygons mapped by `maps` (k, 3, 3), which bring their outlines onto the `right` ones,
    px of the right image. "Where they are" is the best shift of at most `config.near` cells, as outlines are not exact;
    a polygon is `config.patch` cells wide and high. "Other shifts" are up to half a polygon, and count by the quantile
    `config.rival`. 0 where too little of a polygon is seen to tell.
    """
    box, size = _around(right), 2 * config.patch
    inside = covered(warped, box, size) & covered(right, box, size)

    def peak(rows: slice) -> Array:
        (left, seen), (other, seen_there) = rectified(images, box[rows], maps[rows], config, max_halvings)
        both = inside[rows] & seen & seen_there
        found = _peak(correlations(left, other, both, config), config)
        return np.where(both.sum((1, 2)) < config.min_cells, 0.0, found)

    return np.concatenate([np.zeros(0), *in_chunks(peak, len(right), together(size))])


def rectified(
    images: tuple[Image, Image], box: Array, maps: Array, config: VerifyConfig, max_halvings: int
) -> list[tuple[Patches, Bits]]:
    """What each image shows in n boxes (n, 4), px of the right one: `normalised` patches of 2 x `config.patch` cells,
    and where it shows them. `maps` (n, 3, 3) lead from the left image to the right one."""
    back = np.linalg.inv(maps).astype(np.float64), np.broadcast_to(np.eye(3), maps.shape)
    found = (sampled(i, box, m, 2 * config.patch, max_halvings) for i, m in zip(images, back, strict=True))
    return [(normalised(values, config), seen) for values, seen in found]


def normalised(patches: Patches, config: VerifyConfig) -> Patches:
    """Each cell's grey value, less the mean around it, in standard deviations there: light and contrast drop out."""
    result = np.empty_like(patches)

    def normalise(rows: slice) -> None:
        last = np.ascontiguousarray(patches[rows].transpose(1, 2, 0))  # all are blurred at once
        mean = _blurred(last, config.light)
        variance = np.maximum(_blurred(last * last, config.light) - mean * mean, 0)
        result[rows] = ((last - mean) / (np.sqrt(variance) + config.noise)).transpose(2, 0, 1)

    in_chunks(normalise, len(patches), CHANNELS)
    return result


def _blurred(patches: Patches, side: int) -> Patches:
    """The mean in a window around each cell of (size, size, k)."""
    return np.asarray(cv2.blur(patches, (side, side)), np.float32).reshape(patches.shape)


def correlations(left: Patches, right: Patches, inside: Bits, config: VerifyConfig) -> Patches:
    """(k, size, size) the correlation of `left` inside the polygon with `right` shifted by [y, x] cells, cyclic; -1..1.

    By Fourier transforms: for each shift the sums of a normalised cross-correlation with a mask. 0 where one of both
    has no contrast.
    """
    cells = np.maximum(inside.sum((1, 2)), 1).astype(np.float32)[:, None, None]
    mask = inside.astype(np.float32)
    left = (left - (left * mask).sum((1, 2), keepdims=True) / cells) * mask
    right = right - right.mean((1, 2), keepdims=True)
    left_f, mask_f, right_f, square_f = (scipy.fft.rfft2(each) for each in (left, mask, right, right * right))
    shape = left.shape[1:]
    both, first, second = (
        scipy.fft.irfft2(np.conj(a) * b, s=shape) for a, b in ((left_f, right_f), (mask_f, right_f), (mask_f, square_f))
    )
    energy, other = (left * left).sum((1, 2), keepdims=True), np.maximum(second - first * first / cells, 0)
    contrast = cells * config.min_contrast**2
    return np.where((energy > contrast) & (other > contrast), both / np.sqrt(np.maximum(energy * other, 1e-12)), 0.0)


def _peak(found: Patches, config: VerifyConfig) -> Array:
    shift = np.abs(np.fft.fftfreq(found.shape[1], 1 / found.shape[1]))
    far = np.maximum(shift[:, None], shift)
    beside = (far <= config.patch / 2) & (far > 2 * config.near)
    here = found[:, far <= config.near].max(1)
    if not beside.any():  # of so few cells that all are near
        return np.zeros(len(found))
    return np.asarray(here - np.quantile(found[:, beside], config.rival, axis=1), np.float64)


def _around(shapes: NDArray[np.object_]) -> Array:
    """(k, 4) the bounds of each polygon, twice as wide and high (room for a shift by half of it), at least 16 px."""
    bounds = shapely.bounds(shapes).reshape(-1, 4)
    middle, half = (bounds[:, :2] + bounds[:, 2:]) / 2, np.maximum(bounds[:, 2:] - bounds[:, :2], 8.0)
    return np.c_[middle - half, middle + half]
