"""Outlines as region files hold them: parts, pixels, one ring."""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.formats.regions.region import GivenRegion, Photograph, Shape
from zpm2.model import Mask
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.repair import polygons_in
from zpm2.polygons.shapes import as_objects
from zpm2.polygons.trace import trace

Array = NDArray[np.float64]


def shape_of(region: GivenRegion) -> Shape | None:
    """A given region as one valid shape, px, not cut at the image; None where it has no area.

    Pixels are traced along their edges, and crossing rings are repaired.
    """
    if isinstance(region.body, Mask):
        found = trace(region.body.bits, region.body.x0, region.body.y0) if region.body.bits.size else []
        return joined(found)
    found = []
    for rings in region.body:
        if rings and len(rings[0]) >= 3:
            shape = shapely.Polygon(rings[0], [ring for ring in rings[1:] if len(ring) >= 3])
            found += polygons_in(shape if shape.is_valid else repaired(shape))
    together = joined(found)
    return together if together is None or together.is_valid else joined(polygons_in(shapely.unary_union(found)))


def repaired(shape: shapely.Polygon) -> Shape:
    """What the rings of an invalid polygon enclose by the even-odd rule; a ring that is there twice counts once.

    Each ring is repaired alone: `make_valid` of all of them fills a hole that shares an edge with another ring.
    """
    rings = shapely.polygons(shapely.get_rings(shape))
    distinct = dict(zip(shapely.normalize(rings).tolist(), rings, strict=True)).values()
    valid = [shapely.make_valid(ring) for ring in distinct]
    parts = as_objects([shapely.MultiPolygon(polygons_in(each)) for each in valid])
    while len(parts) > 1:  # by twos, as one by one takes long for many holes
        half = len(parts) // 2
        pairs = shapely.symmetric_difference(parts[:half], parts[half : 2 * half])
        parts = np.concatenate([pairs, parts[2 * half :]])
    return shapely.MultiPolygon(polygons_in(parts[0]))


def joined(parts: list[shapely.Polygon]) -> Shape | None:
    """Polygons as one shape; None where there are none."""
    return None if not parts else parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def parts_of(shape: Shape) -> list[shapely.Polygon]:
    """The polygons of a shape."""
    return list(shapely.get_parts(shape))


def rings_of(polygon: shapely.Polygon) -> list[Array]:
    """The exterior and the holes, each (n, 2) with the first vertex repeated at the end."""
    return [shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)]


def one_ring(shape: Shape) -> Array:
    """(n, 2) a shape as a single ring, not repeated at the end, for formats that know neither holes nor parts.

    Rings are joined by lines that are walked there and back: filled by the even-odd rule, the ring is the shape. Each
    line is the shortest one to the nearest ring, so it crosses none.
    """
    merged, *others = [ring for part in parts_of(shape) for ring in rings_of(shapely.geometry.polygon.orient(part))]
    lines = as_objects([shapely.linestrings(ring) for ring in others])
    away = shapely.distance(shapely.linestrings(merged), lines)
    while others:
        nearest = int(np.argmin(away))
        ring, line = others.pop(nearest), lines[nearest]
        here, there = shapely.get_coordinates(shapely.shortest_line(shapely.linestrings(merged), line))
        edge, last = _edge_of(merged, here), _edge_of(ring, there)
        added = np.concatenate([[here, there], ring[last + 1 :], ring[1 : last + 1], [there, here]])
        split = shapely.linestrings(merged[edge : edge + 2])
        merged = np.concatenate([merged[: edge + 1], added, merged[edge + 1 :]])
        lines, away = np.delete(lines, nearest), np.delete(away, nearest)
        near = shapely.distance(split, lines) <= away  # whose distance rounds anew
        away = np.minimum(away, shapely.distance(shapely.linestrings(added), lines))
        away[near] = shapely.distance(shapely.linestrings(merged), lines[near])
    return merged[:-1][(merged[:-1] != merged[1:]).any(1)]


def _edge_of(ring: Array, point: Array) -> int:
    """The row of the closed ring's edge that a point lies on."""
    edges = shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1))
    return int(np.argmin(shapely.distance(edges, shapely.points(point))))


def pixels_of(shape: Shape, photograph: Photograph) -> Mask:
    """The pixels of a shape, cut at the borders of the photograph; a mask of 0 x 0 px where none is inside."""
    mask = rasterize(shape)
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    right, bottom = max(left, photograph.width - mask.x0), max(top, photograph.height - mask.y0)
    return cropped(Mask(mask.x0 + left, mask.y0 + top, mask.bits[top:bottom, left:right]))


def cropped(mask: Mask) -> Mask:
    """A mask without empty rows and columns around it; of 0 x 0 px where it is empty."""
    rows, columns = np.flatnonzero(mask.bits.any(1)), np.flatnonzero(mask.bits.any(0))
    if not len(rows):
        return Mask(0, 0, np.zeros((0, 0), bool))
    bits = mask.bits[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return Mask(mask.x0 + int(columns[0]), mask.y0 + int(rows[0]), np.array(bits, order="C"))
