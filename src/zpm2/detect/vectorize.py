"""Pixels to polygons and back: rings along pixel edges, Douglas-Peucker, which polygon lies in which."""

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import VectorizeConfig
from zpm2.model import Mask, Polygon

AREA_CHANGE = 0.2  # share of a polygon's area that simplification may add or take
CONTAINED = 0.95  # share of a polygon's area that must lie in another one for that to be its parent


def vectorize(masks: Sequence[Mask], config: VectorizeConfig, min_area: float, size: tuple[int, int]) -> list[Polygon]:
    """One polygon per mask, in the order of the masks, with ids 0, 1, ... and parents (paper 3.2).

    A polygon has one exterior, so the largest 4-connected piece of a mask stands for it. `size` is the image's (width,
    height) in px; what a mask has beyond it is cut off. Holes under `min_area` px^2 are filled; a piece that is then
    smaller than `min_area` gives no polygon. Simplified by Douglas-Peucker with `config.tolerance` px; where that would
    break a polygon, change its area by more than a fifth (a line one pixel wide) or bring it under `min_area`, the
    exact outline stays.
    """
    return with_parents(outlines(masks, config, min_area, size)[0])


def outlines(
    masks: Sequence[Mask], config: VectorizeConfig, min_area: float, size: tuple[int, int]
) -> tuple[list[Polygon], NDArray[np.int64]]:
    """The polygons of `vectorize`, without parents, and (n,) the row of the mask that each stands for."""
    rows, shapes, corners = [], [], []
    for row, mask in enumerate(masks):
        parts = pieces(_cut(mask, size))
        shape = _without_small_holes(_outline(parts[0].bits), min_area) if parts else shapely.Polygon()
        if shape.area >= max(min_area, 1.0):
            rows.append(row)
            shapes.append(shape)
            corners.append((parts[0].x0, parts[0].y0))
    simple = _simplify(shapes, config.tolerance, min_area)
    moved = zip(simple, corners, strict=True)
    placed = [shapely.transform(shape, lambda xy, corner=corner: xy + corner) for shape, corner in moved]
    sources = [masks[row] for row in rows]
    polygons = [from_shape(s, k, m.score, m.label) for k, (s, m) in enumerate(zip(placed, sources, strict=True))]
    return polygons, np.array(rows, np.int64)


def trace(bits: NDArray[np.bool_], x0: int = 0, y0: int = 0) -> list[shapely.Polygon]:
    """The outlines of a (h, w) mask whose first pixel is column `x0`, row `y0`: one polygon per 4-connected piece, with
    its holes, the largest first, along pixel edges and exact: areas are pixel counts. No vertex lies on a straight run.

    >>> trace(np.ones((3, 4), bool))[0].area
    12.0
    """
    return [
        shapely.transform(_outline(part.bits), lambda xy, corner=(part.x0, part.y0): xy + corner)
        for part in pieces(Mask(x0, y0, bits))
    ]


def rasterize(shape: shapely.Polygon) -> Mask:
    """The pixels whose centre lies in `shape` (image px), as the crop of its bounds; undoes `trace`.

    A centre on an outline belongs to what lies to the right of it or below, so that polygons which share an edge share
    no pixel and leave none out.
    """
    x_min, y_min, x_max, y_max = shape.bounds
    x0, y0 = int(np.floor(x_min)), int(np.floor(y_min))
    width, height = int(np.ceil(x_max)) - x0, int(np.ceil(y_max)) - y0
    rings = [shapely.get_coordinates(ring) for ring in (shape.exterior, *shape.interiors)]
    a, b = np.concatenate([ring[:-1] for ring in rings]), np.concatenate([ring[1:] for ring in rings])
    down = (a[:, 1] <= b[:, 1])[:, None]
    a, b = np.where(down, a, b), np.where(down, b, a)  # an edge is the same from both of its sides, to the last bit
    first = np.ceil(a[:, 1] - 0.5).astype(np.int64)  # rows whose centre line an edge crosses
    count = np.ceil(b[:, 1] - 0.5).astype(np.int64) - first
    edge = np.repeat(np.arange(len(a)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    a, b = a[edge], b[edge]
    crossing = a[:, 0] + (row + 0.5 - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    column = np.ceil(crossing - 0.5).astype(np.int64)  # first pixel with its centre right of the crossing
    crossings = np.bincount((row - y0) * (width + 1) + column - x0, minlength=height * (width + 1))
    inside = np.cumsum(crossings.reshape(height, width + 1), axis=1)[:, :width] % 2 == 1
    return Mask(x0, y0, inside)


def pieces(mask: Mask, min_area: float = 0.0) -> list[Mask]:
    """The 4-connected pieces of a mask with at least `min_area` pixels, each in its own crop, the largest first."""
    if not mask.bits.any():
        return []
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.bits.astype(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    found = []
    for k in np.argsort(-areas, kind="stable"):
        if areas[k] < min_area:
            break
        x, y, w, h = (int(v) for v in stats[k + 1, :4])
        bits = labels[y : y + h, x : x + w] == k + 1
        found.append(Mask(mask.x0 + x, mask.y0 + y, bits, mask.score, mask.label))
    return found


def from_shape(shape: shapely.Polygon, id: int, score: float = 1.0, label: str | None = None) -> Polygon:
    """A shapely polygon (image px) as ours: exterior with a positive shoelace sum, holes with a negative one."""
    holes = tuple(_ring(ring, positive=False) for ring in shape.interiors)
    return Polygon(id, _ring(shape.exterior, positive=True), holes, score, None, label)


def reshaped(polygon: Polygon, shape: shapely.Polygon) -> Polygon:
    """The polygon with another outline (image px); all else that is known of it stays."""
    outline = from_shape(shape, polygon.id)
    return dataclasses.replace(polygon, exterior=outline.exterior, holes=outline.holes)


def with_parents(polygons: Sequence[Polygon]) -> list[Polygon]:
    """The same polygons, each with the id of the smallest larger one that holds at least 95 % of its area as parent."""
    if not polygons:
        return []
    shapes = np.array([p.shape for p in polygons], object)
    areas = shapely.area(shapes)
    child, parent = shapely.STRtree(shapes).query(shapes)
    boxes = shapely.bounds(shapes)
    common = np.minimum(boxes[child, 2:], boxes[parent, 2:]) - np.maximum(boxes[child, :2], boxes[parent, :2])
    possible = (areas[parent] > areas[child]) & (common.prod(1) >= CONTAINED * areas[child])
    child, parent = child[possible], parent[possible]
    held = shapely.area(shapely.intersection(shapes[child], shapes[parent])) >= CONTAINED * areas[child]
    child, parent = child[held], parent[held]
    order = np.lexsort((parent, areas[parent], child))
    _, first = np.unique(child[order], return_index=True)
    parent_of = {int(c): polygons[int(p)].id for c, p in zip(child[order][first], parent[order][first], strict=True)}
    return [dataclasses.replace(p, parent=parent_of.get(k)) for k, p in enumerate(polygons)]


def _cut(mask: Mask, size: tuple[int, int]) -> Mask:
    """What of a mask lies in an image of `size` (width, height) px."""
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    right, bottom = max(0, size[0] - mask.x0), max(0, size[1] - mask.y0)
    return dataclasses.replace(mask, x0=mask.x0 + left, y0=mask.y0 + top, bits=mask.bits[top:bottom, left:right])


def _outline(bits: NDArray[np.bool_]) -> shapely.Polygon:
    """The exact polygon of one 4-connected piece that fills its (h, w) crop.

    OpenCV walks through pixel centres. On the piece enlarged twice, the centre at k lies beside the pixel edge
    (k + 1) // 2 of the original, for exteriors, holes and concave corners alike.
    """
    enlarged = bits.repeat(2, axis=0).repeat(2, axis=1).view(np.uint8)
    contours, hierarchy = cv2.findContours(enlarged, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    rings = [_corners((contour.reshape(-1, 2) + 1) // 2) for contour in contours]
    inner = hierarchy[0, :, 3] >= 0
    exterior = rings[int(np.argmin(inner))]
    return shapely.Polygon(exterior, [ring for ring, is_hole in zip(rings, inner, strict=True) if is_hole])


def _corners(ring: NDArray[np.int32]) -> NDArray[np.float64]:
    """An (n, 2) closed ring of horizontal and vertical steps without repeated and straight-on vertices."""
    ring = ring[(ring != np.roll(ring, 1, axis=0)).any(1)]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turns = before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]
    return np.asarray(ring[turns], np.float64)


def _without_small_holes(shape: shapely.Polygon, min_area: float) -> shapely.Polygon:
    return shapely.Polygon(shape.exterior, [h for h in shape.interiors if shapely.Polygon(h).area >= min_area])


def _simplify(shapes: Sequence[shapely.Polygon], tolerance: float, min_area: float) -> NDArray[np.object_]:
    """Douglas-Peucker that keeps topology; a shape that it would break or change too much stays exact."""
    exact = np.array(shapes, object)
    if not len(exact):
        return exact
    simple = shapely.simplify(exact, tolerance, preserve_topology=True)
    before, after = shapely.area(exact), shapely.area(simple)
    alike = (np.abs(after - before) <= AREA_CHANGE * before) & (after >= min_area)
    return np.asarray(np.where(shapely.is_valid(simple) & alike, simple, exact))


def _ring(ring: shapely.LinearRing, positive: bool) -> NDArray[np.float64]:
    """(n, 2) vertices without the closing one, turned so that the shoelace sum has the sign asked for."""
    vertices = shapely.get_coordinates(ring)[:-1]
    return np.ascontiguousarray(vertices if shapely.is_ccw(ring) == positive else vertices[::-1])
