"""Masks to polygons: outlines along pixel edges, simplified by Douglas-Peucker, with their parents (paper 3.2)."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import VectorizeConfig
from zpm2.model import Mask, Polygon
from zpm2.polygons.nest import with_parents
from zpm2.polygons.shapes import from_shape
from zpm2.polygons.simplify import simplify
from zpm2.polygons.trace import outline_of_piece, pieces


def vectorize(masks: Sequence[Mask], config: VectorizeConfig, min_area: float, size: tuple[int, int]) -> list[Polygon]:
    """One polygon per mask, in the order of the masks, with ids 0, 1, ... and parents (paper 3.2).

    A polygon has one exterior, so it is the outline of the largest 4-connected piece of a mask. `size` is the image's
    (width, height) in px; masks are cut off there. Holes under `min_area` px^2 are filled; a piece that is then smaller
    than `min_area` gives no polygon. The outline is simplified (`simplify`), unless that would break it or change it
    too much, as a line one pixel wide.
    """
    return with_parents(outlines(masks, config, min_area, size)[0], config)


def outlines(
    masks: Sequence[Mask], config: VectorizeConfig, min_area: float, size: tuple[int, int]
) -> tuple[list[Polygon], NDArray[np.int64]]:
    """The polygons of `vectorize`, without parents, and (n,) the row of the mask that each stands for."""
    rows, shapes, corners = [], [], []
    for row, mask in enumerate(masks):
        parts = pieces(_cut(mask, size))
        shape = without_small_holes(outline_of_piece(parts[0].bits), min_area) if parts else shapely.Polygon()
        if shape.area >= max(min_area, 1.0):
            rows.append(row)
            shapes.append(shape)
            corners.append((parts[0].x0, parts[0].y0))
    simple = simplify(shapes, config, min_area)
    moved = zip(simple, corners, strict=True)
    placed = [shapely.transform(shape, lambda xy, corner=corner: xy + corner) for shape, corner in moved]
    sources = [masks[row] for row in rows]
    polygons = [from_shape(s, k, m.score, m.label) for k, (s, m) in enumerate(zip(placed, sources, strict=True))]
    return polygons, np.array(rows, np.int64)


def _cut(mask: Mask, size: tuple[int, int]) -> Mask:
    """The part of a mask inside an image of `size` (width, height) px."""
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    right, bottom = max(0, size[0] - mask.x0), max(0, size[1] - mask.y0)
    return dataclasses.replace(mask, x0=mask.x0 + left, y0=mask.y0 + top, bits=mask.bits[top:bottom, left:right])


def without_small_holes(shape: shapely.Polygon, min_area: float) -> shapely.Polygon:
    """The shape, with holes under `min_area` px^2 filled."""
    return shapely.Polygon(shape.exterior, [h for h in shape.interiors if shapely.Polygon(h).area >= min_area])
