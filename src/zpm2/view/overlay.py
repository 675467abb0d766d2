"""Both photographs in one picture: what was matched has one colour and one number in both."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Image, Polygon, PolygonMatch
from zpm2.view.palette import distinct_colors

Pixels = NDArray[np.uint8]

SCREEN = 16 / 9  # width / height that the layout comes close to
MAX_ENLARGEMENT = 2.0  # small photographs are shown up to this much larger, so that labels find room
GAP = 8  # px between the photographs
HEADER = 44  # px
DARK = (24, 24, 27)
PALE = (214, 214, 214)


@dataclass(frozen=True)
class _Region:
    """A polygon on its panel."""

    rings: list[NDArray[np.int32]]  # OpenCV points in 1/16 px, pixel centres at 0: exterior, then holes
    box: tuple[int, int, int, int]  # x0, y0, x1, y1 panel px, end excluded
    area: float  # share of the photograph, of the larger one of a matched pair
    color: tuple[int, int, int]
    label: str


def overlay(
    left: Image,
    right: Image,
    left_polygons: Sequence[Polygon],
    right_polygons: Sequence[Polygon],
    matches: Sequence[PolygonMatch],
    max_width: int = 2400,
) -> Pixels:
    """(h, w, 3) uint8 RGB: the two photographs side by side, or one above the other where that fits a screen better.

    Matched polygons are filled and outlined in one colour and carry the position of their match in `matches`, from 0,
    in both photographs; unmatched ones have a thin pale outline. Larger polygons lie below and are more transparent.
    max_width: px, no side of the result is longer. The same input gives the same picture. `InputError` where a match
    names a polygon that is not there.
    """
    by_id = _by_id(left_polygons, "left"), _by_id(right_polygons, "right")
    for match in matches:
        if match.left not in by_id[0] or match.right not in by_id[1]:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
    sizes, stacked = _layout((left.width, left.height), (right.width, right.height), max_width)
    pairs = [(by_id[0][match.left], by_id[1][match.right]) for match in matches]
    colors = distinct_colors(*_places([p for p, _ in pairs]))
    areas = [max(_share(p, left), _share(q, right)) for p, q in pairs]
    panels = []
    for k, (image, polygons) in enumerate(((left, left_polygons), (right, right_polygons))):
        matched = [_region(pair[k], image, sizes[k], areas[n], colors[n], str(n)) for n, pair in enumerate(pairs)]
        used = {pair[k].id for pair in pairs}
        others = [_region(p, image, sizes[k], 0, PALE, "") for p in polygons if p.id not in used]
        panels.append(_panel(image, sizes[k], matched, others, ("left", "right")[k]))
    title = (
        f"{len(matches)} {'match' if len(matches) == 1 else 'matches'} of {len(left_polygons)} left and "
        f"{len(right_polygons)} right polygons"
    )
    return _assemble(panels, stacked, title)


def _by_id(polygons: Sequence[Polygon], side: str) -> Mapping[int, Polygon]:
    table = {p.id: p for p in polygons}
    if len(table) != len(polygons):
        raise InputError(f"two {side} polygons have the same id: number them first")
    return table


def _layout(
    left: tuple[int, int], right: tuple[int, int], max_side: int
) -> tuple[tuple[tuple[int, int], tuple[int, int]], bool]:
    """(width, height) px of both panels, equal in height side by side or in width stacked, and whether stacked."""
    aspects = np.array([left[0] / left[1], right[0] / right[1]])
    beside, above = float(aspects.sum()), float(1 / (1 / aspects).sum())
    stacked = abs(math.log(above / SCREEN)) < abs(math.log(beside / SCREEN))
    common = 0 if stacked else 1  # the panels have one width, or one height
    largest = MAX_ENLARGEMENT * max(left[common], right[common])
    if stacked:
        width = min(max_side, (max_side - HEADER - GAP) * above, largest)
        sides = [(width, width / aspect) for aspect in aspects]
    else:
        height = min(max_side - HEADER, (max_side - GAP) / beside, largest)
        sides = [(height * aspect, height) for aspect in aspects]
    a, b = ((max(1, int(w)), max(1, int(h))) for w, h in sides)
    return (a, b), stacked


def _places(polygons: Sequence[Polygon]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 2) middles of the boxes of polygons, and (n,) half of their longer sides, px."""
    boxes = np.array([p.bounds for p in polygons]).reshape(-1, 2, 2)
    return boxes.mean(1), np.ptp(boxes, axis=1).max(1, initial=0) / 2


def _share(polygon: Polygon, image: Image) -> float:
    return polygon.area / (image.width * image.height)


def _region(
    polygon: Polygon, image: Image, size: tuple[int, int], area: float, color: tuple[int, int, int], label: str
) -> _Region:
    scale = np.array(size) / (image.width, image.height)
    rings = [np.rint((ring * scale - 0.5) * 16).astype(np.int32) for ring in (polygon.exterior, *polygon.holes)]
    low = np.clip(np.floor(polygon.exterior.min(0) * scale), 0, size).astype(int)
    high = np.clip(np.ceil(polygon.exterior.max(0) * scale) + 1, 0, size).astype(int)
    return _Region(rings, (int(low[0]), int(low[1]), int(high[0]), int(high[1])), area, color, label)


def _panel(
    image: Image, size: tuple[int, int], matched: Sequence[_Region], others: Sequence[_Region], name: str
) -> Pixels:
    """One photograph, muted, with its polygons."""
    shrink = size[0] < image.width
    rgb = cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_CUBIC)
    gray = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    panel = cv2.addWeighted(rgb, 0.35, gray, 0.5, 0)
    order = sorted(matched, key=lambda region: -region.area)
    owner = np.full(panel.shape[:2], -1, np.int32)
    masks = []
    for k, region in enumerate(order):
        x0, y0, x1, y1 = region.box
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        masks.append(mask)
        if not mask.size:
            continue
        cv2.fillPoly(mask, [ring - np.array([x0 * 16, y0 * 16], np.int32) for ring in region.rings], 255, shift=4)
        part = panel[y0:y1, x0:x1]
        alpha = float(np.interp(math.sqrt(region.area), (0.05, 0.5), (0.6, 0.25)))
        tint = np.full_like(part, region.color)
        cv2.copyTo(cv2.addWeighted(part, 1 - alpha, tint, alpha, 0), mask, part)
        owner[y0:y1, x0:x1][mask > 0] = k
    for region in others:
        cv2.polylines(panel, region.rings, True, PALE, 1, cv2.LINE_AA, shift=4)
    for region in order:
        cv2.polylines(panel, region.rings, True, DARK, 4, cv2.LINE_AA, shift=4)
        cv2.polylines(panel, region.rings, True, region.color, 2, cv2.LINE_AA, shift=4)
    return _label(panel, order, masks, owner, name)


def _label(
    panel: Pixels, order: Sequence[_Region], masks: Sequence[Pixels], owner: NDArray[np.int32], name: str
) -> Pixels:
    """The panel with the regions' numbers, small regions first: each at the point farthest from the border of what is
    seen of its region and from the labels that are there already."""
    picture = PIL.Image.fromarray(panel)
    draw = PIL.ImageDraw.Draw(picture)
    height, width = owner.shape
    free = np.full((height, width), 255, np.uint8)
    _write(draw, free, (10, 6), name, 16, "lt")
    for k in reversed(range(len(order))):
        x0, y0, x1, y1 = order[k].box
        if not masks[k].any():
            continue
        seen = np.where(owner[y0:y1, x0:x1] == k, masks[k], 0).astype(np.uint8)
        spot, radius = _pole(seen if seen.any() else masks[k], free[y0:y1, x0:x1])
        font = int(np.clip(radius * 0.9, 15, 28))
        _write(draw, free, (x0 + spot[0], y0 + spot[1]), order[k].label, font, "mm")
    return np.asarray(picture)


def _pole(mask: Pixels, free: Pixels) -> tuple[tuple[int, int], float]:
    """(x, y) of the pixel of `mask` farthest from its border and from what is not `free`, and that distance in px."""
    for candidate in (cv2.bitwise_and(mask, free), mask):
        padded = cv2.copyMakeBorder(candidate, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        _, radius, _, (x, y) = cv2.minMaxLoc(cv2.distanceTransform(padded, cv2.DIST_L2, 3))
        if radius > 1.5:
            break
    return (x - 1, y - 1), float(radius)


def _write(draw: PIL.ImageDraw.ImageDraw, free: Pixels, at: tuple[int, int], text: str, size: int, anchor: str) -> None:
    """White text with a dark halo, moved inside the panel; the place around it is no longer `free`."""
    font = PIL.ImageFont.load_default(size)
    halo = 2
    x0, y0, x1, y1 = draw.textbbox(at, text, font=font, anchor=anchor, stroke_width=halo)
    height, width = free.shape
    dx = max(0, 1 - x0) - max(0, x1 - width + 1)
    dy = max(0, 1 - y0) - max(0, y1 - height + 1)
    draw.text((at[0] + dx, at[1] + dy), text, (255, 255, 255), font, anchor, stroke_width=halo, stroke_fill=DARK)
    margin_x, margin_y = int(x1 - x0) // 2 + 2, int(y1 - y0) // 2 + 2  # half of a label of like size fits beside it
    row = slice(max(0, int(y0 + dy) - margin_y), max(0, int(y1 + dy) + margin_y))
    free[row, max(0, int(x0 + dx) - margin_x) : max(0, int(x1 + dx) + margin_x)] = 0


def _assemble(panels: Sequence[Pixels], stacked: bool, title: str) -> Pixels:
    shape = np.array([panel.shape[:2] for panel in panels])
    step = (int(shape[0, 0]) + GAP, 0) if stacked else (0, int(shape[0, 1]) + GAP)
    height = int(shape[:, 0].sum()) + GAP if stacked else int(shape[:, 0].max())
    width = int(shape[:, 1].max()) if stacked else int(shape[:, 1].sum()) + GAP
    canvas = np.empty((height + HEADER, width, 3), np.uint8)
    canvas[:] = DARK
    for panel, (y, x) in zip(panels, ((0, 0), step), strict=True):
        canvas[HEADER + y : HEADER + y + panel.shape[0], x : x + panel.shape[1]] = panel
    picture = PIL.Image.fromarray(canvas)
    draw = PIL.ImageDraw.Draw(picture)
    middle = HEADER // 2
    font, small = PIL.ImageFont.load_default(20), PIL.ImageFont.load_default(15)
    draw.text((12, middle), title, (255, 255, 255), font, "lm")
    legend = "same colour and number: the same surface      thin pale outline: not matched"
    if draw.textlength(title, font) + draw.textlength(legend, small) + 60 < width:
        draw.text((width - 12, middle), legend, PALE, small, "rm")
    return np.asarray(picture)
