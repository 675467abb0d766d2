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
from zpm2.local_match.texture import TexturePatches, together
from zpm2.model import Image
from zpm2.polygons.rasterize import rasterize_stack

Array = NDArray[np.float64]
Patches = NDArray[np.float32]  # (k, size, size)
Bits = NDArray[np.bool_]


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
    to_image: tuple[Array, Array] = np.linalg.inv(maps).astype(np.float64), np.tile(np.eye(3), (len(maps), 1, 1))

    def peak(rows: slice) -> Array:
        frames = shapely.box(*box[rows].T)
        sides = [
            TexturePatches(image, frames, back[rows], size, max_halvings)
            for image, back in zip(images, to_image, strict=True)
        ]
        values = [normalised(side.values.reshape(-1, size, size), config) for side in sides]
        seen = [side.inside.reshape(-1, size, size) for side in sides]
        both = inside(warped[rows], box[rows], size) & inside(right[rows], box[rows], size) & seen[0] & seen[1]
        found = _peak(correlations(values[0], values[1], both, config), config)
        return np.where(both.sum((1, 2)) < config.min_cells, 0.0, found)

    return np.concatenate([np.zeros(0), *in_chunks(peak, len(right), together(size))])


def normalised(patches: Patches, config: VerifyConfig) -> Patches:
    """Each cell's grey value, less the mean around it, in standard deviations there: light and contrast drop out."""
    side = (config.light, config.light)
    result = np.empty_like(patches)
    for row, patch in enumerate(patches):
        mean = cv2.blur(patch, side)
        variance = np.maximum(cv2.blur(patch * patch, side) - mean * mean, 0)
        result[row] = (patch - mean) / (np.sqrt(variance) + config.noise)
    return result


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


def inside(shapes: NDArray[np.object_], box: Array, size: int) -> Bits:
    """(k, size, size) which cells of its `box` are in each polygon."""
    xy, of = shapely.get_coordinates(shapes, return_index=True)
    cells = (xy - box[of, :2]) * (size / (box[of, 2:] - box[of, :2]))
    return rasterize_stack(shapely.set_coordinates(shapes.copy(), cells), (size, size))
