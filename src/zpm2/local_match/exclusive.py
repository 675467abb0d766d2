"""Mutually exclusive matched regions (claimed by the paper in 3.4), exact to the pixel.

Regions of segment everything contain and overlap each other. Here each pixel of both images goes to one match at most.
Both images use the same order of matches, so that of two overlapping matches the same one gets the pixels in both. The
most confident match comes first, but parts (polygons that lie mostly in a larger one) come before their wholes.

The matches take their pixels in that order. Of the pixels that earlier matches left, a match either keeps one
4-connected piece in each image, which may have holes, or it is dropped and takes nothing. Pixels of dropped matches and
of other pieces remain for later matches. No match takes pixels from an earlier one, so one pass is enough: a second one
changes nothing.
"""

import dataclasses
from collections.abc import Sequence
from heapq import heapify, heappop, heappush

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config, ExclusiveConfig
from zpm2.model import ImagePolygons, Mask, Polygon, PolygonMatch
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.shapes import reshaped
from zpm2.polygons.trace import pieces, trace

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Size = tuple[int, int]  # width, height of an image, px


def without_overlaps(
    left: ImagePolygons,
    right: ImagePolygons,
    matches: Sequence[PolygonMatch],
    pairs: Sequence[tuple[Polygon, Polygon]],
    maps: Array,
    config: Config,
) -> tuple[ImagePolygons, ImagePolygons, list[PolygonMatch]]:
    """Both images of a pair and its matches, without pixels that two matches share.

    `pairs` are the polygons of each match; for the other arguments see `exclusive`. The polygons of dropped matches
    stay unchanged, with "rejected" as the reason why they have no partner. Homologous vertices and outlines belong to
    the old exteriors and are left out.
    """
    confidence = np.array([match.confidence for match in matches], np.float64)
    sizes = (left.width, left.height), (right.width, right.height)
    kept = exclusive(pairs, confidence, maps, sizes, config.segment.min_area, config.local_match.exclusive)
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
    """The side with `polygons` replacing those of the same ids. The ids `lost` no longer have a partner."""
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
    config: ExclusiveConfig,
) -> list[tuple[Polygon, Polygon] | None]:
    """What each of n matched (left, right) polygons keeps; None for the matches that are dropped.

    `confidence` (n,) ranks the matches. `maps` (n, 3, 3) lead from left to right: right ~ map @ left, image px. `sizes`
    are those of the images. A match that lost no pixels stays. Any other match is dropped if one of its pieces has less
    than `min_area` pixels, or if the two pieces no longer correspond because different parts were taken in the two
    images. They correspond if the IoU of the right piece and the warped left one reaches `config.min_overlap`, or the
    share `config.min_kept` of the IoU of the whole polygons.

    A polygon's pixels are those with their centre inside. The pieces are traced along pixel edges, so areas are pixel
    counts; id, score, parent and label stay. The order of the pairs does not matter if their left ids are distinct.
    """
    sides = _ImageMasks([left for left, _ in pairs], sizes[0]), _ImageMasks([right for _, right in pairs], sizes[1])
    parts = [side.parts(config.min_part) for side in sides]
    result: list[tuple[Polygon, Polygon] | None] = [None] * len(pairs)
    for k in order([left.id for left, _ in pairs], confidence, parts, _sizes(sides)):
        kept = _kept_pieces(sides, k, maps[k], min_area, config)
        if kept is not None:
            for side, mask in zip(sides, kept, strict=True):
                side.take(mask)
            result[k] = _traced(pairs[k][0], kept[0]), _traced(pairs[k][1], kept[1])
    return result


def order(ids: Sequence[int], confidence: Array, parts: Sequence[NDArray[np.int64]], size: Array) -> list[int]:
    """The rows of n matches in the order in which they take pixels: the most confident first, but parts before wholes.

    A part ranks by the confidence of its most confident whole, so that a whole need not wait for a part behind matches
    that are less confident than the whole. Ties: by the part's own `confidence` (n,), then by the least of `ids`.
    `parts` are (c, 2) pairs of rows (part, whole), of each image; only those count in which the part has the lesser
    `size` (n,), so that there is an order even where the images contradict each other.
    """
    n = len(ids)
    pairs = np.unique(np.concatenate([np.zeros((0, 2), np.int64), *parts]), axis=0)
    pairs = pairs[size[pairs[:, 0]] < size[pairs[:, 1]]]
    pairs = pairs[np.argsort(-size[pairs[:, 1]], kind="stable")]  # a whole inherits its rank before it passes it on
    rank = confidence.tolist()
    waiting = [0] * n
    wholes: list[list[int]] = [[] for _ in range(n)]
    for part, whole in pairs.tolist():
        rank[part] = max(rank[part], rank[whole])
        waiting[whole] += 1
        wholes[part].append(whole)
    ready = [(-rank[k], -confidence[k], ids[k], k) for k in range(n) if not waiting[k]]
    heapify(ready)
    result = []
    while ready:
        k = heappop(ready)[-1]
        result.append(k)
        for whole in wholes[k]:
            waiting[whole] -= 1
            if not waiting[whole]:
                heappush(ready, (-rank[whole], -confidence[whole], ids[whole], whole))
    return result


class _ImageMasks:
    """The pixels of one image's polygons, packed eight to a byte, and which pixels are taken."""

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
        """Those of its pixels that no match has taken."""
        mask = self.mask(k)
        return dataclasses.replace(mask, bits=mask.bits & ~self._window(mask))

    def take(self, mask: Mask) -> None:
        """Marks the pixels of `mask` as taken."""
        window = self._window(mask)
        window |= mask.bits

    def parts(self, min_part: float) -> NDArray[np.int64]:
        """(c, 2) pairs (part, whole): the part has fewer pixels, more than the share `min_part` of them in the
        whole."""
        boxes, areas = self.boxes, self.areas
        tree = shapely.STRtree(shapely.box(*boxes.T.astype(float)))
        part, whole = tree.query(tree.geometries)
        common = np.minimum(boxes[part, 2:], boxes[whole, 2:]) - np.maximum(boxes[part, :2], boxes[whole, :2])
        possible = (areas[part] < areas[whole]) & (common.prod(1) > min_part * areas[part])
        part, whole = part[possible], whole[possible]
        inside = np.zeros(len(part), bool)
        by_whole = np.argsort(whole, kind="stable")
        for rows in np.split(by_whole, np.flatnonzero(np.diff(whole[by_whole])) + 1):
            if len(rows):
                larger = self.mask(int(whole[rows[0]]))
                inside[rows] = [self._pixels_in(larger, int(k)) > min_part * areas[k] for k in part[rows]]
        return np.c_[part, whole][inside].astype(np.int64)

    def _pixels_in(self, larger: Mask, k: int) -> int:
        """How many pixels of polygon k lie in `larger`."""
        mask = self.mask(k)
        (x0, y0), (h, w) = (mask.x0 - larger.x0, mask.y0 - larger.y0), mask.bits.shape
        window = larger.bits[max(y0, 0) : y0 + h, max(x0, 0) : x0 + w]
        part = mask.bits[max(-y0, 0) :, max(-x0, 0) :][: window.shape[0], : window.shape[1]]
        return int(np.count_nonzero(window & part))

    def _window(self, mask: Mask) -> Bits:
        y, x = mask.y0 - self.corner[1], mask.x0 - self.corner[0]
        return self.taken[y : y + mask.bits.shape[0], x : x + mask.bits.shape[1]]


def _sizes(sides: tuple[_ImageMasks, _ImageMasks]) -> Array:
    """(n,) the size of each match: the product of its areas in both images."""
    return sides[0].areas.astype(np.float64) * sides[1].areas


def _kept_pieces(
    sides: tuple[_ImageMasks, _ImageMasks], k: int, matrix: Array, min_area: float, config: ExclusiveConfig
) -> tuple[Mask, Mask] | None:
    """The pieces that match k keeps, one in each image; None if there are none or they do not correspond.

    Of the free pieces that are large enough, they are the two that share the most pixels when warped.
    """
    areas = [int(side.areas[k]) for side in sides]
    free = [side.free(k) for side in sides]
    parts = [
        pieces(mask, min_area if mask.area < area else 1, config.max_pieces)
        for mask, area in zip(free, areas, strict=True)
    ]
    if not parts[0] or not parts[1]:
        return None
    shared = _shared_pixels(parts[0], parts[1], matrix)
    a, b = np.unravel_index(np.argmax(shared), shared.shape)
    left, right = parts[0][a], parts[1][b]
    if [left.area, right.area] == areas:
        return left, right
    before = _overlap(sides, sides[0].mask(k), sides[1].mask(k), matrix)
    least = min(config.min_overlap, config.min_kept * before)
    return (left, right) if _overlap(sides, left, right, matrix) >= least else None


def _overlap(sides: tuple[_ImageMasks, _ImageMasks], left: Mask, right: Mask, matrix: Array) -> float:
    """IoU, 0..1, of two masks within the area that both images show.

    It follows from the share of each mask that the other one covers when warped.
    """
    back = np.asarray(np.linalg.inv(matrix), np.float64)
    shared = _shared_pixels([right], [left], back)[0, 0], _shared_pixels([left], [right], matrix)[0, 0]
    visible = _visible_pixels(left, back, sides[1].size), _visible_pixels(right, matrix, sides[0].size)
    return float(1 / (visible[0] / shared[0] + visible[1] / shared[1] - 1)) if min(shared) > 0 else 0.0


def _visible_pixels(mask: Mask, matrix: Array, size: Size) -> int:
    """How many pixels of a mask the other image, of `size`, shows, too; `matrix` leads from that image to this one."""
    width, height = size
    whole = np.array([[width, 0, width / 2], [0, height, height / 2], [0, 0, 1]])  # the other image as a single pixel
    visible = _warped(np.ones((1, 1), np.uint8), matrix @ whole, mask.x0, mask.y0, mask.bits.shape)
    return int(np.count_nonzero(np.logical_and(mask.bits, visible)))


def _shared_pixels(source: Sequence[Mask], target: Sequence[Mask], matrix: Array) -> NDArray[np.int64]:
    """(s, t) pixels that each of s disjoint masks, warped by `matrix` (target ~ matrix @ source, image px), shares
    with each of t disjoint masks of the other image. At most 254 each: their labels are bytes."""
    (x, y, labels), (u, v, others) = _label_image(source), _label_image(target)
    warped = _warped(labels, matrix @ [[1, 0, x + 0.5], [0, 1, y + 0.5], [0, 0, 1]], u, v, others.shape)
    both = np.logical_and(warped, others)
    if len(source) == len(target) == 1:
        return np.array([[np.count_nonzero(both)]])
    counts = np.bincount(warped[both].astype(np.int64) * 256 + others[both], minlength=256 * 256)
    return np.asarray(counts.reshape(256, 256)[1 : len(source) + 1, 1 : len(target) + 1])


def _warped(labels: NDArray[np.uint8], matrix: Array, x0: int, y0: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The labels warped into the crop of `shape` at (x0, y0).

    `matrix` maps OpenCV's px (first pixel centre at 0) to image px.
    """
    to_crop = np.array([[1, 0, -x0 - 0.5], [0, 1, -y0 - 0.5], [0, 0, 1]])
    return np.asarray(cv2.warpPerspective(labels, to_crop @ matrix, shape[::-1], flags=cv2.INTER_NEAREST), np.uint8)


def _label_image(masks: Sequence[Mask]) -> tuple[int, int, NDArray[np.uint8]]:
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
