"""Polygons of one image on its pixels: one label raster, however much they overlap, and never a stack of masks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from zpm2.model import Polygon

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Cells:
    """The pixels of n polygons, cut into the m cells in which the same polygons lie; cell 0 is in no polygon."""

    labels: NDArray[np.int32]  # (h, w) the cell of each pixel
    members: Any  # (n, m) scipy.sparse csr_array of 0 and 1: polygon k holds cell c
    sizes: NDArray[np.int64]  # (m,) pixels of each cell
    pixels: NDArray[np.int64]  # (n,) pixels of each polygon

    def union(self, polygons: Rows) -> NDArray[np.bool_]:
        """(m,) whether a cell lies in one of the polygons, which are given by their rows."""
        return np.asarray(self.members[np.unique(polygons)].sum(axis=0) > 0)

    def at(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """(k,) the cell under each of (k, 2) points, image px; points beyond the border count to the pixel next."""
        height, width = self.labels.shape
        columns = np.clip(points[:, 0].astype(np.intp), 0, width - 1)
        rows = np.clip(points[:, 1].astype(np.intp), 0, height - 1)
        return self.labels[rows, columns]


def to_cells(polygons: Sequence[Polygon], width: int, height: int) -> Cells:
    """The cells of all polygons of a width x height px image. Row k of everything is `polygons[k]`, whatever its id.

    Each polygon splits the cells that it meets, so the work grows with the sum of the bounding boxes and the memory
    with the image alone.
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
    return Cells(labels, members, sizes, np.asarray(members @ sizes))


def polygon_pixels(polygon: Polygon, width: int, height: int) -> tuple[tuple[slice, slice], NDArray[np.bool_]]:
    """The window (rows, columns) of the image in which a polygon lies, and the pixels of the window that are its.

    Pixels that the outline touches belong to the polygon and those that a hole's outline touches do not: the rule of
    OpenCV's fillPoly on vertices rounded to 1/16 px, whose centres it counts from 0.
    """
    x0, y0, x1, y1 = polygon.bounds
    left, right = np.clip([np.floor(x0) - 2, np.ceil(x1) + 2], 0, width).astype(int)
    top, bottom = np.clip([np.floor(y0) - 2, np.ceil(y1) + 2], 0, height).astype(int)
    window = slice(int(top), int(bottom)), slice(int(left), int(right))
    mask = np.zeros((bottom - top, right - left), np.uint8)
    if mask.size:
        for value, rings in ((1, [polygon.exterior]), (0, polygon.holes)):
            for ring in rings:
                sixteenths = np.rint((ring - 0.5) * 16) - 16 * np.array([left, top])
                cv2.fillPoly(mask, [sixteenths.astype(np.int32)], value, shift=4)
    return window, mask.astype(bool)


def _membership(holders: Sequence[tuple[int, ...]], n: int) -> Any:
    polygons = np.array([k for held in holders for k in held], np.intp)
    cells = np.repeat(np.arange(len(holders)), [len(held) for held in holders])
    ones = np.ones(len(polygons), np.int64)
    return scipy.sparse.csr_array((ones, (polygons, cells)), shape=(n, len(holders)))
