"""Texture: R, the correlation of the grey values in two polygons (paper 3.4.2, Eq. R)."""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cores import in_chunks
from zpm2.global_match import Candidates
from zpm2.model import Image
from zpm2.photos.sampling import bilinear, levels
from zpm2.polygons.rasterize import rasterize_stack

Array = NDArray[np.float64]
PAIR_CHUNK = 256  # pairs that are compared at a time
PATCH_CELLS = 1 << 16  # of patches that are sampled at a time: what a core keeps near


class TexturePatches:
    """Square patches of the polygons of one image, all of the same size, with their masks.

    Patch k is the bounding box of `frames[k]` resampled to size x size: `values` (n, size^2), and `inside` (n, size^2)
    where the polygon is. `frames` are shapely polygons in px of the right image, which `to_image` (n, 3, 3) maps to the
    sampled image (by the identity for the right image itself). So both patches of a pair are rectified to one frame. An
    image is halved up to `max_halvings` times before a large polygon is sampled.
    """

    def __init__(
        self, image: Image, frames: NDArray[np.object_], to_image: Array, size: int, max_halvings: int
    ) -> None:
        self.size, self.max_halvings = size, max_halvings
        n = len(frames)
        self.values = np.zeros((n, size * size), np.float32)
        self.inside = np.zeros((n, size * size), bool)
        usable = np.flatnonzero(~shapely.is_empty(frames))

        def sample(part: slice) -> None:
            rows = usable[part]
            self._sample(rows, frames[rows], to_image[rows], image)

        in_chunks(sample, len(usable), together(size))

    def _sample(self, rows: NDArray[np.intp], frames: NDArray[np.object_], to_image: Array, image: Image) -> None:
        x0, y0, x1, y1 = shapely.bounds(frames).T
        along = (np.arange(self.size) + 0.5) / self.size
        x, y = (low[:, None] + (high - low)[:, None] * along for low, high in ((x0, x1), (y0, y1)))
        column, row, seen = _mapped(to_image, x[:, None, :], y[:, :, None])
        seen = seen & (column >= 0) & (row >= 0) & (column <= image.width) & (row <= image.height)
        extent = np.maximum(*(at.max((1, 2)) - at.min((1, 2)) for at in (column, row)))
        spread = np.nan_to_num(extent / self.size, nan=1.0, posinf=1.0)
        level = np.clip(np.floor(np.log2(np.maximum(spread, 1.0))), 0, self.max_halvings).astype(int)
        for k in np.unique(level):
            of = level == k
            at = (each[of] / 2.0**k - 0.5 for each in (column, row))
            self.values[rows[of]] = bilinear(levels(image, k, 2)[k], *at).reshape(of.sum(), -1)
        self.inside[rows] = seen.reshape(len(rows), -1) & self._coverage(frames, x0, y0, x1, y1)

    def _coverage(self, frames: NDArray[np.object_], x0: Array, y0: Array, x1: Array, y1: Array) -> NDArray[np.bool_]:
        scale = self.size / np.maximum(np.c_[x1 - x0, y1 - y0], 1e-9)
        xy, of = shapely.get_coordinates(frames, return_index=True)
        own = shapely.set_coordinates(frames.copy(), (xy - np.c_[x0, y0][of]) * scale[of])  # px of the patch
        return rasterize_stack(own, (self.size, self.size)).reshape(len(frames), -1)


def together(size: int) -> int:
    """How many patches of size x size cells are worked on at a time."""
    return max(1, PATCH_CELLS // size**2)


def _mapped(maps: Array, x: Array, y: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Columns and rows of the points of grids with `x` (n, 1, size) and `y` (n, size, 1), each mapped by its (3, 3) of
    (n, 3, 3), and whether they are in front of the horizon. All three broadcast to (n, size, size)."""
    if (maps == np.eye(3)).all():
        return x, y, np.ones((1, 1, 1), bool)
    column, row, depth = (
        m[:, 0, None, None] * x + (m[:, 1, None, None] * y + m[:, 2, None, None]) for m in maps.transpose(1, 0, 2)
    )
    seen = depth > 1e-9
    depth = np.where(seen, depth, 1.0)
    return column / depth, row / depth, seen


def correlation(patches: tuple[TexturePatches, TexturePatches], pairs: Candidates, min_contrast: float) -> Array:
    """(c,) R of each pair, -1..1, over the pixels of the frame that lie in both polygons. 0 where there is no texture:
    the geometric mean of both standard deviations is at most `min_contrast` grey levels."""
    left, right = patches
    result = np.zeros(len(pairs))
    for start in range(0, len(pairs), PAIR_CHUNK):
        i, j = pairs.left[start : start + PAIR_CHUNK], pairs.right[start : start + PAIR_CHUNK]
        both = left.inside[i] & right.inside[j]
        count = np.maximum(both.sum(1), 1)
        a, b = left.values[i].astype(np.float64), right.values[j].astype(np.float64)
        a = np.where(both, a - ((a * both).sum(1) / count)[:, None], 0.0)
        b = np.where(both, b - ((b * both).sum(1) / count)[:, None], 0.0)
        energy = (a**2).sum(1) * (b**2).sum(1)
        textured = energy > (count * min_contrast**2) ** 2
        result[start : start + PAIR_CHUNK] = np.where(
            textured, (a * b).sum(1) / np.sqrt(np.maximum(energy, 1e-12)), 0.0
        )
    return result
