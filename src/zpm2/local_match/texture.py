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

    Patch k is the bounding box of `frames[k]`, `sampled` at size x size: `values` (n, size^2), and `inside` (n, size^2)
    where the polygon is. `frames` are shapely polygons in px of the right image, which `to_image` (n, 3, 3) maps to the
    sampled image (by the identity for the right image itself). So both patches of a pair are rectified to one frame.
    """

    def __init__(
        self, image: Image, frames: NDArray[np.object_], to_image: Array, size: int, max_halvings: int
    ) -> None:
        n = len(frames)
        self.values = np.zeros((n, size * size), np.float32)
        self.inside = np.zeros((n, size * size), bool)
        usable = np.flatnonzero(~shapely.is_empty(frames))
        frames = frames[usable]
        box = shapely.bounds(frames).reshape(-1, 4)
        values, seen = sampled(image, box, to_image[usable], size, max_halvings)
        self.values[usable] = values.reshape(-1, size * size)
        self.inside[usable] = (seen & covered(frames, box, size)).reshape(-1, size * size)


def sampled(
    image: Image, box: Array, to_image: Array, size: int, max_halvings: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(n, size, size) the grey values of an image in n boxes, and where the image shows them.

    A `box` (n, 4), x0, y0, x1, y1, is in px of another image, which `to_image` (n, 3, 3) maps to this one. An image is
    halved up to `max_halvings` times before a large box is sampled.
    """
    values, seen = np.zeros((len(box), size, size), np.float32), np.zeros((len(box), size, size), bool)
    along = (np.arange(size) + 0.5) / size

    def sample(part: slice) -> None:
        x0, y0, x1, y1 = box[part].T
        x, y = (low[:, None] + (high - low)[:, None] * along for low, high in ((x0, x1), (y0, y1)))
        column, row, ahead = _mapped(to_image[part], x[:, None, :], y[:, :, None])
        seen[part] = ahead & (column >= 0) & (row >= 0) & (column <= image.width) & (row <= image.height)
        extent = np.maximum(*(at.max((1, 2)) - at.min((1, 2)) for at in (column, row)))
        spread = np.nan_to_num(extent / size, nan=1.0, posinf=1.0)
        level = np.clip(np.floor(np.log2(np.maximum(spread, 1.0))), 0, max_halvings).astype(int)
        for k in np.unique(level):
            of = level == k
            at = (each[of] / 2.0**k - 0.5 for each in (column, row))
            values[part][of] = bilinear(levels(image, k, 2)[k], *at)

    in_chunks(sample, len(box), together(size))
    return values, seen


def covered(shapes: NDArray[np.object_], box: Array, size: int) -> NDArray[np.bool_]:
    """(n, size, size) which cells of its `box` (n, 4) are in each polygon (n,)."""
    scale = size / np.maximum(box[:, 2:] - box[:, :2], 1e-9)
    xy, of = shapely.get_coordinates(shapes, return_index=True)
    cells = shapely.set_coordinates(shapes.copy(), (xy - box[of, :2]) * scale[of])
    return rasterize_stack(cells, (size, size))


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
