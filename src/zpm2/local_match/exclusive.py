"""Mutually exclusive matched regions (the paper's claim of 3.4), exact to the pixel.

Regions of segment everything lie in and across each other. Here every pixel of both images goes to one match at most.
One order of all matches holds in both images, so that where two overlap the same one wins on both sides: the surest
match first, but parts (polygons of which most lies in a larger one) before their wholes.

Matches take pixels in that order. Each is offered what those before it left of its two polygons, and either keeps one
4-connected piece on each side (holes are fine) or goes entirely, and takes nothing. So what a match that goes, or a
piece that is cut off, would have had is still there for the next ones. A later match never takes from an earlier one:
one pass settles it, and nothing changes if it is done again.
"""

import dataclasses
from collections.abc import Sequence
from heapq import heapify, heappop, heappush

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import ImagePolygons, Mask, Polygon, PolygonMatch
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.shapes import reshaped
from zpm2.polygons.trace import pieces, trace

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Size = tuple[int, int]  # width, height of an image, px
MOSTLY = 0.5  # share of a polygon's pixels in a larger one, beyond which it is a part of that one
MIN_OVERLAP = 0.5  # IoU of the two pieces of a match, one carried to the other, with which they correspond for sure
MIN_KEPT = 0.8  # share of its polygons' own IoU with which the pieces of a match that had less at first correspond
PIECES = 200  # of one polygon that are looked at, the largest ones


def without_overlaps(
    left: ImagePolygons,
    right: ImagePolygons,
    matches: Sequence[PolygonMatch],
    pairs: Sequence[tuple[Polygon, Polygon]],
    maps: Array,
    min_area: float,
) -> tuple[ImagePolygons, ImagePolygons, list[PolygonMatch]]:
    """Both images of a pair and its matches, without pixels that two matches share.

    `pairs` are the polygons of each match; for the rest see `exclusive`. The polygons of matches that go stay as they
    were, and have "rejected" as the reason why they have no partner. Homologous vertices and outlines were those of
    the old exteriors, and are left out.
    """
    confidence = np.array([match.confidence for match in matches], np.float64)
    sizes = (left.width, left.height), (right.width, right.height)
    kept = exclusive(pairs, confidence, maps, sizes, min_area)
    lost = [match for match, pair in zip(matches, kept, strict=True) if pair is None]
    found = [pair for pair in kept if pair is not None]
    return (
        _updated(left, [polygon for polygon, _ in found], [match.left for match in lost]),
        _updated(right, [polygon for _, polygon in found], [match.right for match in lost]),
        [
            dataclasses.replace(match, nodes=np.zeros((0, 2), np.int64), outline=np.zeros((0, 5)))
            for match, pair in zip(matches, kept, strict=True)
            if pair is not None
        ],
    )


def _updated(side: ImagePolygons, polygons: Sequence[Polygon], lost: Sequence[int]) -> ImagePolygons:
    """The side with `polygons` in the place of those that have their ids, and without a partner for the ids `lost`."""
    new = {polygon.id: polygon for polygon in polygons}
    return dataclasses.replace(
        side,
        polygons=[new.get(polygon.id, polygon) for polygon in side.polygons],
        unmatched={**side.unmatched, **dict.fromkeys(lost, "rejected")},
    )


def exclusive(
    pairs: Sequence[tuple[Polygon, Polygon]],
    confidence: Array,
    maps: Array,
    sizes: tuple[Size, Size],
    min_area: float,
) -> list[tuple[Polygon, Polygon] | None]:
    """What each of n matched (left, right) polygons keeps, or None for those that go.

    `confidence` (n,) ranks the matches, `maps` (n, 3, 3) carry them: right ~ map @ left, image px; `sizes` are those of
    the images. A match goes if something was taken from it and a piece that is left has less than `min_area` pixels, or
    if the two pieces do not correspond any more, as different parts were taken in the two images: the carried one must
    overlap the other by `MIN_OVERLAP`, or by `MIN_KEPT` of what the whole polygons did. A match from which nothing was
    taken stays.

    A polygon's pixels are those with their centre inside. What is kept is traced along pixel edges, so areas are pixel
    counts, with all else that is known of the polygon. The order of the pairs does not matter, as long as
    their left ids are distinct.
    """
    sides = _Side([left for left, _ in pairs], sizes[0]), _Side([right for _, right in pairs], sizes[1])
    result: list[tuple[Polygon, Polygon] | None] = [None] * len(pairs)
    for k in order([left.id for left, _ in pairs], confidence, [side.within() for side in sides], _sizes(sides)):
        kept = _keep(sides, k, maps[k], min_area)
        if kept is not None:
            for side, mask in zip(sides, kept, strict=True):
                side.take(mask)
            result[k] = _traced(pairs[k][0], kept[0]), _traced(pairs[k][1], kept[1])
    return result


def order(ids: Sequence[int], confidence: Array, within: Sequence[NDArray[np.int64]], size: Array) -> list[int]:
    """The rows of n matches, first come first served: the surest first, but parts before the wholes that they lie in.

    A part counts as sure as the surest of its wholes, else a whole would wait for a part behind what is less sure than
    the whole. Ties: by `confidence` (n,) itself, then the least of `ids`. `within` are (c, 2) pairs of rows
    (part, whole), of either image; where the images do not agree, those count in which the part has the lesser `size`
    (n,), so that there is always an order.
    """
    n = len(ids)
    pairs = np.unique(np.concatenate([np.zeros((0, 2), np.int64), *within]), axis=0)
    pairs = pairs[size[pairs[:, 0]] < size[pairs[:, 1]]]
    pairs = pairs[np.argsort(-size[pairs[:, 1]], kind="stable")]  # what a whole inherits is settled before it passes on
    sure = confidence.tolist()
    waiting = [0] * n
    wholes: list[list[int]] = [[] for _ in range(n)]
    for part, whole in pairs.tolist():
        sure[part] = max(sure[part], sure[whole])
        waiting[whole] += 1
        wholes[part].append(whole)
    ready = [(-sure[k], -confidence[k], ids[k], k) for k in range(n) if not waiting[k]]
    heapify(ready)
    result = []
    while ready:
        k = heappop(ready)[-1]
        result.append(k)
        for whole in wholes[k]:
            waiting[whole] -= 1
            if not waiting[whole]:
                heappush(ready, (-sure[whole], -confidence[whole], ids[whole], whole))
    return result


class _Side:
    """One image: the pixels of its polygons, packed eight to a byte, and which pixels are taken."""

    def __init__(self, polygons: Sequence[Polygon], size: Size) -> None:
        self.size = size
        self.packed: list[NDArray[np.uint8]] = []
        self.boxes = np.zeros((len(polygons), 4), np.int64)  # x0, y0, x1, y1, end excluded
        self.areas = np.zeros(len(polygons), np.int64)
        for k, polygon in enumerate(polygons):
            mask = rasterize(polygon.shape)
            height, width = mask.bits.shape
            self.packed.append(np.packbits(mask.bits))
            self.boxes[k] = mask.x0, mask.y0, mask.x0 + width, mask.y0 + height
            self.areas[k] = mask.area
        self.corner = self.boxes[:, :2].min(0, initial=0)
        width, height = self.boxes[:, 2:].max(0, initial=0) - self.corner
        self.taken = np.zeros((height, width), bool)

    def mask(self, k: int) -> Mask:
        """All pixels of polygon k."""
        x0, y0, x1, y1 = self.boxes[k].tolist()
        bits = np.unpackbits(self.packed[k], count=(y1 - y0) * (x1 - x0)).view(bool)
        return Mask(x0, y0, bits.reshape(y1 - y0, x1 - x0))

    def free(self, k: int) -> Mask:
        """Those that nobody has taken."""
        mask = self.mask(k)
        return dataclasses.replace(mask, bits=mask.bits & ~self._window(mask))

    def take(self, mask: Mask) -> None:
        window = self._window(mask)
        window |= mask.bits

    def within(self) -> NDArray[np.int64]:
        """(c, 2) pairs (part, whole): the part has fewer pixels, and most of them in the whole."""
        boxes, areas = self.boxes, self.areas
        tree = shapely.STRtree(shapely.box(*boxes.T.astype(float)))
        part, whole = tree.query(tree.geometries)
        common = np.minimum(boxes[part, 2:], boxes[whole, 2:]) - np.maximum(boxes[part, :2], boxes[whole, :2])
        possible = (areas[part] < areas[whole]) & (common.prod(1) > MOSTLY * areas[part])
        part, whole = part[possible], whole[possible]
        held = np.zeros(len(part), bool)
        by_whole = np.argsort(whole, kind="stable")
        for rows in np.split(by_whole, np.flatnonzero(np.diff(whole[by_whole])) + 1):
            if len(rows):
                around = self.mask(int(whole[rows[0]]))
                held[rows] = [self._shared(around, int(k)) > MOSTLY * areas[k] for k in part[rows]]
        return np.c_[part, whole][held].astype(np.int64)

    def _shared(self, around: Mask, k: int) -> int:
        """How many pixels of polygon k lie in `around`."""
        mask = self.mask(k)
        (x0, y0), (h, w) = (mask.x0 - around.x0, mask.y0 - around.y0), mask.bits.shape
        held = around.bits[max(y0, 0) : y0 + h, max(x0, 0) : x0 + w]
        part = mask.bits[max(-y0, 0) :, max(-x0, 0) :][: held.shape[0], : held.shape[1]]
        return int(np.count_nonzero(held & part))

    def _window(self, mask: Mask) -> Bits:
        y, x = mask.y0 - self.corner[1], mask.x0 - self.corner[0]
        return self.taken[y : y + mask.bits.shape[0], x : x + mask.bits.shape[1]]


def _sizes(sides: tuple[_Side, _Side]) -> Array:
    """(n,) of a match, over both images: the geometric mean of its areas in px, squared."""
    return sides[0].areas.astype(np.float64) * sides[1].areas


def _keep(sides: tuple[_Side, _Side], k: int, matrix: Array, min_area: float) -> tuple[Mask, Mask] | None:
    """The pieces that match k keeps, one on each side: of the free ones that are large enough, those two that share
    the most pixels when carried; None where none are left or those do not correspond."""
    areas = [int(side.areas[k]) for side in sides]
    free = [side.free(k) for side in sides]
    parts = [pieces(mask, min_area if mask.area < area else 1)[:PIECES] for mask, area in zip(free, areas, strict=True)]
    if not parts[0] or not parts[1]:
        return None
    shared = _shared_pixels(parts[0], parts[1], matrix)
    a, b = np.unravel_index(np.argmax(shared), shared.shape)
    left, right = parts[0][a], parts[1][b]
    if [left.area, right.area] == areas:
        return left, right
    before = _overlap(sides, sides[0].mask(k), sides[1].mask(k), matrix)
    return (left, right) if _overlap(sides, left, right, matrix) >= min(MIN_OVERLAP, MIN_KEPT * before) else None


def _overlap(sides: tuple[_Side, _Side], left: Mask, right: Mask, matrix: Array) -> float:
    """IoU of two masks where both images see them, from the share of each that the other one, carried, covers. 0..1."""
    back = np.asarray(np.linalg.inv(matrix), np.float64)
    shared = _shared_pixels([right], [left], back)[0, 0], _shared_pixels([left], [right], matrix)[0, 0]
    seen = _seen(left, back, sides[1].size), _seen(right, matrix, sides[0].size)
    return float(1 / (seen[0] / shared[0] + seen[1] / shared[1] - 1)) if min(shared) > 0 else 0.0


def _seen(mask: Mask, matrix: Array, size: Size) -> int:
    """How many pixels of a mask show what the other image, of `size`, shows too; `matrix` leads from that one here."""
    width, height = size
    whole = np.array([[width, 0, width / 2], [0, height, height / 2], [0, 0, 1]])  # the other image as a single pixel
    seen = _warped(np.ones((1, 1), np.uint8), matrix @ whole, mask.x0, mask.y0, mask.bits.shape)
    return int(np.count_nonzero(np.logical_and(mask.bits, seen)))


def _shared_pixels(source: Sequence[Mask], target: Sequence[Mask], matrix: Array) -> NDArray[np.int64]:
    """(s, t) pixels that each of s disjoint masks, carried by `matrix` (target ~ matrix @ source, image px), shares
    with each of t disjoint masks of the other image."""
    (x, y, labels), (u, v, others) = _painted(source), _painted(target)
    warped = _warped(labels, matrix @ [[1, 0, x + 0.5], [0, 1, y + 0.5], [0, 0, 1]], u, v, others.shape)
    both = np.logical_and(warped, others)
    if len(source) == len(target) == 1:
        return np.array([[np.count_nonzero(both)]])
    counts = np.bincount(warped[both].astype(np.int64) * 256 + others[both], minlength=256 * 256)
    return np.asarray(counts.reshape(256, 256)[1 : len(source) + 1, 1 : len(target) + 1])


def _warped(labels: NDArray[np.uint8], matrix: Array, x0: int, y0: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Labels in the crop of `shape` at (x0, y0). `matrix` leads to image px from OpenCV's, pixel centres from 0 on."""
    to_crop = np.array([[1, 0, -x0 - 0.5], [0, 1, -y0 - 0.5], [0, 0, 1]])
    return np.asarray(cv2.warpPerspective(labels, to_crop @ matrix, shape[::-1], flags=cv2.INTER_NEAREST), np.uint8)


def _painted(masks: Sequence[Mask]) -> tuple[int, int, NDArray[np.uint8]]:
    """x0, y0 of the crop that holds all masks, and the crop: 1, 2, ... in the first, second, ... mask, 0 elsewhere."""
    ends = [(m.x0 + m.bits.shape[1], m.y0 + m.bits.shape[0]) for m in masks]
    x0, y0 = min(m.x0 for m in masks), min(m.y0 for m in masks)
    crop = np.zeros((max(y for _, y in ends) - y0, max(x for x, _ in ends) - x0), np.uint8)
    for k, mask in enumerate(masks):
        (height, width), y, x = mask.bits.shape, mask.y0 - y0, mask.x0 - x0
        crop[y : y + height, x : x + width][mask.bits] = k + 1
    return x0, y0, crop


def _traced(polygon: Polygon, piece: Mask) -> Polygon:
    return reshaped(polygon, trace(piece.bits, piece.x0, piece.y0)[0])
