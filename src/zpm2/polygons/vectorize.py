"""Masks to polygons: outlines along pixel edges, simplified by Douglas-Peucker, with their parents (paper 3.2)."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import VectorizeConfig
from zpm2.model import Mask, Polygon, shapes_of_rings
from zpm2.polygons.nest import with_parents
from zpm2.polygons.shapes import rings_of, shoelace
from zpm2.polygons.simplify import simplify
from zpm2.polygons.trace import pieces, rings_of_piece


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
    rows, rings, corners = [], list[list[NDArray[np.float64]]](), []
    for row, mask in enumerate(masks):
        for piece in pieces(cut(mask, size), most=1):
            exterior, *holes = rings_of_piece(piece.bits)
            kept = [exterior, *(hole for hole in holes if _area(hole) >= min_area)]
            if _area(exterior) - sum(_area(hole) for hole in kept[1:]) >= max(min_area, 1.0):
                rows.append(row)
                rings.append(kept)
                corners.append((piece.x0, piece.y0))
    simple = simplify(shapes_of_rings(rings), config, min_area)
    xy, of = shapely.get_coordinates(simple, return_index=True)
    placed = rings_of(shapely.set_coordinates(simple, xy + np.array(corners, np.float64).reshape(-1, 2)[of]))
    polygons = [
        Polygon(k, exterior, tuple(holes), masks[row].score, None, masks[row].label)
        for k, (row, (exterior, *holes)) in enumerate(zip(rows, placed, strict=True))
    ]
    return polygons, np.array(rows, np.int64)


def _area(ring: NDArray[np.float64]) -> float:
    """px^2 inside a ring (n, 2) along pixel edges: exact."""
    return abs(shoelace(ring)) / 2


def cut(mask: Mask, size: tuple[int, int]) -> Mask:
    """The part of a mask inside an image of `size` (width, height) px."""
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    right, bottom = max(0, size[0] - mask.x0), max(0, size[1] - mask.y0)
    if not (left or top) and mask.bits.shape[0] <= bottom and mask.bits.shape[1] <= right:
        return mask
    return dataclasses.replace(mask, x0=mask.x0 + left, y0=mask.y0 + top, bits=mask.bits[top:bottom, left:right])


def without_small_holes(shape: shapely.Polygon, min_area: float) -> shapely.Polygon:
    """The shape, with holes under `min_area` px^2 filled."""
    return shapely.Polygon(shape.exterior, [h for h in shape.interiors if shapely.Polygon(h).area >= min_area])
