"""The polygons of one image as one label raster, however much they overlap, in the place of a stack of masks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from zpm2.model import Polygon
from zpm2.polygons.rasterize import rasterize

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class LabelRaster:
    """The pixels of n polygons, cut into m cells, each of pixels in the same polygons; cell 0 is in none."""

    labels: NDArray[np.int32]  # (h, w) the cell of each pixel
    members: scipy.sparse.csr_array  # (n, m) of 0 and 1: polygon k holds cell c
    sizes: NDArray[np.int64]  # (m,) pixels of each cell
    pixels: NDArray[np.int64]  # (n,) pixels of each polygon

    def union(self, polygons: Rows) -> NDArray[np.bool_]:
        """(m,) whether a cell lies in one of the `polygons`, given by their rows."""
        return np.asarray(self.members[np.unique(polygons)].sum(axis=0) > 0)

    def at(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """(k,) the cell under each of (k, 2) points, image px; points beyond the border take the nearest pixel."""
        height, width = self.labels.shape
        columns = np.clip(points[:, 0].astype(np.intp), 0, width - 1)
        rows = np.clip(points[:, 1].astype(np.intp), 0, height - 1)
        return self.labels[rows, columns]


def rasterize_labels(polygons: Sequence[Polygon], width: int, height: int) -> LabelRaster:
    """The polygons of an image of width x height px. Row k of each array belongs to `polygons[k]`, whatever its id.

    Each polygon splits the cells that it meets, so that the work grows with the sum of the bounding boxes and the
    memory with the image alone.
    """
    labels = np.zeros((height, width), np.int32)
    holders: list[tuple[int, ...]] = [()]  # of each cell, the polygons that it lies in
    for k in sorted(range(len(polygons)), key=lambda k: -polygons[k].area):
        window, inside = polygon_pixels(polygons[k], width, height)
        before = labels[window][inside]
        split = np.flatnonzero(np.bincount(before))
        renumbered = np.zeros(len(holders), np.int32)
        renumbered[split] = np.arange(len(holders), len(holders) + len(split))
        labels[window][inside] = renumbered[before]
        holders += [(*holders[cell], k) for cell in split]
    sizes = np.bincount(labels.ravel(), minlength=len(holders)).astype(np.int64)
    members = _membership(holders, len(polygons))
    return LabelRaster(labels, members, sizes, np.asarray(members @ sizes))


def polygon_pixels(polygon: Polygon, width: int, height: int) -> tuple[tuple[slice, slice], NDArray[np.bool_]]:
    """The window (rows, columns) of the image in which a polygon lies, and which pixels of the window belong to it.

    A pixel belongs to a polygon if its centre lies inside (`polygons.rasterize.rasterize`): the area of a polygon along
    pixel edges is its number of pixels, and polygons that touch share none.
    """
    mask = rasterize(polygon.shape, (width, height))
    rows, columns = mask.bits.shape
    return (slice(mask.y0, mask.y0 + rows), slice(mask.x0, mask.x0 + columns)), mask.bits


def _membership(holders: Sequence[tuple[int, ...]], n: int) -> scipy.sparse.csr_array:
    polygons = np.array([k for held in holders for k in held], np.intp)
    cells = np.repeat(np.arange(len(holders)), [len(held) for held in holders])
    ones = np.ones(len(polygons), np.int64)
    return scipy.sparse.csr_array((ones, (polygons, cells)), shape=(n, len(holders)))
