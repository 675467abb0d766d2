"""Texture: R, the correlation of what two polygons show (paper 3.4.2, Eq. R)."""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import Image
from zpm2.photos.sampling import bilinear, pyramid
from zpm2.polygons.rasterize import rasterize_stack

Array = NDArray[np.float64]
PAIRS = 256  # compared at a time
PATCHES = 256  # sampled at a time


class Patches:
    """Square patches of polygons of one image, all of the same size, with their masks.

    Patch k is the bounding box of `frames[k]` brought to size x size: values (n, size^2) float32 and whether the
    polygon covers each of them. `frames` are shapely polygons in the right image's coordinates, `to_image` (n, 3, 3)
    brings these back to the image that is sampled (identity for the right image itself), so that both patches of a
    pair are seen through the same, rectified frame.
    """

    def __init__(self, image: Image, frames: NDArray[np.object_], to_image: Array, size: int) -> None:
        self.size = size
        n = len(frames)
        self.values = np.zeros((n, size * size), np.float32)
        self.inside = np.zeros((n, size * size), bool)
        usable = np.flatnonzero(~shapely.is_empty(frames))
        levels = [image.gray]  # each half the size of the one before
        for start in range(0, len(usable), PATCHES):
            rows = usable[start : start + PATCHES]
            self._sample(rows, frames[rows], to_image[rows], levels)

    def _sample(
        self, rows: NDArray[np.intp], frames: NDArray[np.object_], to_image: Array, levels: list[NDArray[np.float32]]
    ) -> None:
        size, (height, width) = self.size, levels[0].shape
        x0, y0, x1, y1 = shapely.bounds(frames).T
        t = (np.arange(size) + 0.5) / size
        x = np.broadcast_to((x0[:, None] + (x1 - x0)[:, None] * t)[:, None, :], (len(rows), size, size))
        y = np.broadcast_to((y0[:, None] + (y1 - y0)[:, None] * t)[:, :, None], (len(rows), size, size))
        homogeneous = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(len(rows), -1, 3)
        mapped = homogeneous @ to_image.transpose(0, 2, 1)
        depth = mapped[..., 2:]
        seen = depth[..., 0] > 1e-9
        at = mapped[..., :2] / np.where(depth > 1e-9, depth, 1.0)
        seen &= (at >= 0).all(-1) & (at[..., 0] <= width) & (at[..., 1] <= height)
        spread = np.nan_to_num(np.ptp(at, axis=1).max(1) / size, nan=1.0, posinf=1.0)
        level = np.clip(np.floor(np.log2(np.maximum(spread, 1.0))), 0, 6).astype(int)
        for k in np.unique(level):
            while len(levels) <= k:
                levels.append(pyramid(levels[-1], 1, 2)[1])
            of = level == k
            self.values[rows[of]] = bilinear(levels[k], at[of] / 2.0**k - 0.5)
        self.inside[rows] = seen & self._cover(frames, x0, y0, x1, y1)

    def _cover(self, frames: NDArray[np.object_], x0: Array, y0: Array, x1: Array, y1: Array) -> NDArray[np.bool_]:
        scale = self.size / np.maximum(np.c_[x1 - x0, y1 - y0], 1e-9)
        xy, of = shapely.get_coordinates(frames, return_index=True)
        own = shapely.set_coordinates(frames.copy(), (xy - np.c_[x0, y0][of]) * scale[of])  # px of the patch
        return rasterize_stack(own, (self.size, self.size)).reshape(len(frames), -1)


def correlation(left: Patches, left_rows: NDArray[np.int64], right: Patches, right_rows: NDArray[np.int64]) -> Array:
    """(c,) R of each pair, -1..1, over what both polygons cover of the frame; 0 where there is no texture."""
    result = np.zeros(len(left_rows))
    for start in range(0, len(left_rows), PAIRS):
        i, j = left_rows[start : start + PAIRS], right_rows[start : start + PAIRS]
        both = left.inside[i] & right.inside[j]
        count = np.maximum(both.sum(1), 1)
        a, b = left.values[i].astype(np.float64), right.values[j].astype(np.float64)
        a = np.where(both, a - ((a * both).sum(1) / count)[:, None], 0.0)
        b = np.where(both, b - ((b * both).sum(1) / count)[:, None], 0.0)
        energy = (a**2).sum(1) * (b**2).sum(1)
        textured = energy > (count * 0.25) ** 2  # half a grey level of standard deviation on each side
        result[start : start + PAIRS] = np.where(textured, (a * b).sum(1) / np.sqrt(np.maximum(energy, 1e-12)), 0.0)
    return result
