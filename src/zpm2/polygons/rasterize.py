"""Polygons to pixels: the one rule for which pixel lies inside.

A pixel is inside if its centre is. A centre on an outline belongs to the polygon to the right of it or below it, so
that polygons with a common edge share no pixel and leave none out.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import Mask

Array = NDArray[np.float64]
CELL_SAMPLES = 4  # along each side of a cell, by which its share inside a shape is counted
PIXEL_CHUNK = 1 << 22  # pixels of a stack that are computed at a time
FEW_CELLS = 60  # cells for each crossing of an outline and a line of pixels, below which each cell is looked at


def rasterize(shape: shapely.Polygon, within: tuple[int, int] | None = None) -> Mask:
    """The pixels inside `shape` (image px), as the crop of its bounds. The inverse of `polygons.trace`.

    What lies beyond an image of the size `within` (width, height) is cut off, where one is given.
    """
    bounds = np.array(shape.bounds) if within is None else np.clip(shape.bounds, 0, (*within, *within))
    x0, y0 = (int(v) for v in np.floor(bounds[:2]))
    x1, y1 = (int(v) for v in np.ceil(bounds[2:]))
    a, b, _ = _edges(np.array([shape], object))
    return Mask(x0, y0, _inside(a, b, np.zeros(len(a), np.int64), 1, (x0, y0), (x1 - x0, y1 - y0))[0])


def rasterize_stack(shapes: NDArray[np.object_], size: tuple[int, int]) -> NDArray[np.bool_]:
    """(n, height, width) the pixels inside each of (n,) polygons or multipolygons, px of an image of `size` (width,
    height). They are cut off at its borders."""
    width, height = size
    bits = np.zeros((len(shapes), height, width), bool)
    for rows in _chunks(len(shapes), max(1, PIXEL_CHUNK // max(1, width * height))):
        a, b, owner = _edges(shapes[rows])
        bits[rows] = _inside(a, b, owner, rows.stop - rows.start, (0, 0), size)
    return bits


def cell_shares(shapes: NDArray[np.object_], scale: float, size: tuple[int, int]) -> Array:
    """(n, height, width) 0..1, the share of each cell of a grid of `size` (width, height) inside each of (n,) shapes,
    px. `scale` is cells per px. By CELL_SAMPLES x CELL_SAMPLES samples a cell."""
    width, height = size
    fine = np.asarray(shapely.transform(shapes, lambda xy: xy * scale * CELL_SAMPLES), object)
    bits = rasterize_stack(fine, (width * CELL_SAMPLES, height * CELL_SAMPLES))
    return np.asarray(bits.reshape(len(shapes), height, CELL_SAMPLES, width, CELL_SAMPLES).mean((2, 4)))


def _edges(shapes: NDArray[np.object_]) -> tuple[Array, Array, NDArray[np.int64]]:
    """Both ends (e, 2) of every edge, the upper one first, and (e,) the row of its shape. An edge is the same, to the
    last bit, for both polygons that share it."""
    parts, of_part = shapely.get_parts(shapes, return_index=True)
    rings, of_ring = shapely.get_rings(parts, return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    together = ring[:-1] == ring[1:]
    a, b = xy[:-1][together], xy[1:][together]
    down = (a[:, 1] <= b[:, 1])[:, None]
    return np.where(down, a, b), np.where(down, b, a), of_part[of_ring[ring[:-1][together]]]


def _inside(
    a: Array, b: Array, owner: NDArray[np.int64], n: int, corner: tuple[int, int], size: tuple[int, int]
) -> NDArray[np.bool_]:
    """(n, height, width) by the even-odd rule, in the window of `size` (width, height) that begins at `corner`."""
    (x0, y0), (width, height) = corner, size
    first = np.ceil(np.clip(a[:, 1] - 0.5, y0, y0 + height)).astype(np.int64)  # rows whose centre line an edge crosses
    count = np.ceil(np.clip(b[:, 1] - 0.5, y0, y0 + height)).astype(np.int64) - first
    edge = np.repeat(np.arange(len(a)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    a, b = a[edge], b[edge]
    crossing = a[:, 0] + (row + 0.5 - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    column = np.ceil(np.clip(crossing - 0.5, x0, x0 + width)).astype(np.int64)  # first centre right of the crossing
    line, column = owner[edge] * height + row - y0, column - x0
    if n * height * width < FEW_CELLS * len(line):
        return _filled(line, column, n * height, width).reshape(n, height, width)
    order = np.lexsort((column, line))
    line, column = line[order].tolist(), column[order].tolist()
    bits = np.zeros((n * height, width), bool)
    for at, start, end in zip(line[::2], column[::2], column[1::2], strict=True):  # rings cross a line in pairs
        bits[at, start:end] = True
    return bits.reshape(n, height, width)


def _filled(line: NDArray[np.int64], column: NDArray[np.int64], lines: int, width: int) -> NDArray[np.bool_]:
    """(lines, width) bits that change at each crossing: faster where cells are few, as it looks at each."""
    changes = np.zeros((lines, width + 1), np.uint8)
    np.add.at(changes, (line, column), np.uint8(1))
    return np.bitwise_xor.accumulate(changes[:, :width] & 1, axis=1).view(np.bool_)


def _chunks(count: int, most: int) -> Iterator[slice]:
    for start in range(0, count, most):
        yield slice(start, min(start + most, count))
