"""Both photographs in one picture: what was matched has one colour and one number in both."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

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
CROWD = 300  # matches; of more, small regions have thin outlines and no numbers
SMALL = 24  # px, the longer side of such a region
LEAST = 15  # px, the smallest height of a number
PALE_CROWD = 3000  # unmatched polygons of one photograph; the outlines of more are fainter
FAINTEST = 0.2  # 0..1 of the outlines' strength
HALO = 2  # px around text
WIDE = 2.0  # a label may be so much wider than the free circle that it is put on
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

    @property
    def side(self) -> int:
        """Of the box, the longer one, px."""
        x0, y0, x1, y1 = self.box
        return max(x1 - x0, y1 - y0)


@dataclass(frozen=True)
class _Label:
    """Text on a panel, white with a dark halo."""

    text: str
    at: tuple[float, float]  # panel px
    size: int  # of the font, px
    anchor: str


def overlay(
    left: Image,
    right: Image,
    left_polygons: Sequence[Polygon],
    right_polygons: Sequence[Polygon],
    matches: Sequence[PolygonMatch],
    max_width: int = 2400,
    sizes: tuple[tuple[int, int], tuple[int, int]] | None = None,
) -> Pixels:
    """(h, w, 3) uint8 RGB: the two photographs side by side, or one above the other where that fits a screen better.

    Matched polygons are filled and outlined in one colour and carry the id of their match in both photographs;
    unmatched ones have a thin pale outline. Larger polygons lie below and are more transparent.
    Of more than `CROWD` matches, only those carry a number that have room for it in both photographs.
    max_width: px, no side of the result is longer. sizes: (width, height) px of the photographs that the polygons'
    coordinates are of, where `left` and `right` are reduced versions of them; None: the images' own. The same input
    gives the same picture. `InputError` where a match names a polygon that is not there.
    """
    by_id = _by_id(left_polygons, "left"), _by_id(right_polygons, "right")
    for match in matches:
        if match.left not in by_id[0] or match.right not in by_id[1]:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
    full = sizes or ((left.width, left.height), (right.width, right.height))
    panel_sizes, stacked = _layout((left.width, left.height), (right.width, right.height), max_width)
    pairs = [(by_id[0][match.left], by_id[1][match.right]) for match in matches]
    colors = distinct_colors(*_places([p for p, _ in pairs]))
    areas = [max(_share(p, full[0]), _share(q, full[1])) for p, q in pairs]
    crowded = len(matches) > CROWD
    panels, labels = [], []
    for k, (image, polygons) in enumerate(((left, left_polygons), (right, right_polygons))):
        size, scale = panel_sizes[k], np.array(panel_sizes[k]) / full[k]
        matched = [
            _region(pair[k], scale, size, areas[n], colors[n], str(matches[n].id)) for n, pair in enumerate(pairs)
        ]
        used = {pair[k].id for pair in pairs}
        others = [ring for p in polygons if p.id not in used for ring in _rings(p, scale)]
        order = sorted(matched, key=lambda region: -region.area)
        panel, masks, owner = _panel(image, size, order, others, len(polygons) - len(used), crowded)
        panels.append(panel)
        labels.append(_labels(order, masks, owner, ("left", "right")[k], crowded))
    if crowded:
        both = {label.text for label in labels[0]} & {label.text for label in labels[1]} | {"left", "right"}
        labels = [[label for label in side if label.text in both] for side in labels]
    panels = [_write(panel, side) for panel, side in zip(panels, labels, strict=True)]
    title = (
        f"{len(matches)} {'match' if len(matches) == 1 else 'matches'} of {len(left_polygons)} left and "
        f"{len(right_polygons)} right polygons"
    )
    return _assemble(panels, stacked, title, crowded)


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


def _share(polygon: Polygon, size: tuple[int, int]) -> float:
    return polygon.area / (size[0] * size[1])


def _rings(polygon: Polygon, scale: NDArray[np.float64]) -> list[NDArray[np.int32]]:
    """Exterior, then holes, as OpenCV points of the panel in 1/16 px; scale: (2,) panel px per px."""
    return [np.rint((ring * scale - 0.5) * 16).astype(np.int32) for ring in (polygon.exterior, *polygon.holes)]


def _region(
    polygon: Polygon,
    scale: NDArray[np.float64],
    size: tuple[int, int],
    area: float,
    color: tuple[int, int, int],
    label: str,
) -> _Region:
    low = np.clip(np.floor(polygon.exterior.min(0) * scale), 0, size).astype(int)
    high = np.clip(np.ceil(polygon.exterior.max(0) * scale) + 1, 0, size).astype(int)
    box = int(low[0]), int(low[1]), int(high[0]), int(high[1])
    return _Region(_rings(polygon, scale), box, area, color, label)


def _panel(
    image: Image,
    size: tuple[int, int],
    order: Sequence[_Region],
    others: Sequence[NDArray[np.int32]],
    count: int,
    crowded: bool,
) -> tuple[Pixels, list[Pixels], NDArray[np.int32]]:
    """One photograph, muted, with its matched regions, in `order`, and the rings of its `count` others.

    Also, for each region the mask of its box, and (h, w) the uppermost region of each pixel, -1 for none.
    """
    shrink = size[0] < image.width
    rgb = cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_CUBIC)
    gray = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    panel = cv2.addWeighted(rgb, 0.35, gray, 0.5, 0)
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
    outlined = cv2.polylines(panel.copy(), others, True, PALE, 1, cv2.LINE_AA, shift=4)
    strength = max(FAINTEST, min(1.0, PALE_CROWD / max(count, 1)))
    panel = cv2.addWeighted(outlined, strength, panel, 1 - strength, 0) if strength < 1 else outlined
    for region in order:
        small = crowded and region.side < SMALL
        if not small:
            cv2.polylines(panel, region.rings, True, DARK, 4, cv2.LINE_AA, shift=4)
        cv2.polylines(panel, region.rings, True, region.color, 1 if small else 2, cv2.LINE_AA, shift=4)
    return panel, masks, owner


def _labels(
    order: Sequence[_Region], masks: Sequence[Pixels], owner: NDArray[np.int32], name: str, crowded: bool
) -> list[_Label]:
    """The name of the panel and the regions' numbers, small regions first: each at the point farthest from the border
    of what is seen of its region and from the labels that are there already. In a crowd, only where it has room; tiny
    regions may lie below it."""
    tiny = np.array([crowded and region.side < LEAST for region in order] + [False])
    free = np.full(owner.shape, 255, np.uint8)
    labels = [_place(_Label(name, (10, 6), 16, "lt"), free)]
    for k in reversed(range(len(order))):
        x0, y0, x1, y1 = order[k].box
        if not masks[k].any() or (crowded and min(x1 - x0, y1 - y0) < LEAST):
            continue
        above = owner[y0:y1, x0:x1]
        seen = np.where((above == k) | tiny[above], masks[k], 0).astype(np.uint8)
        spot, radius = _pole(seen if crowded or seen.any() else masks[k], free[y0:y1, x0:x1], not crowded)
        label = _Label(order[k].label, (x0 + spot[0], y0 + spot[1]), int(np.clip(radius * 0.9, LEAST, 28)), "mm")
        if crowded:
            u0, v0, u1, v1 = _extent(label)
            if min(x1 - x0, 2 * radius * WIDE) < u1 - u0 or min(y1 - y0, 2 * radius) < v1 - v0:
                continue
        labels.append(_place(label, free))
    return labels


def _pole(mask: Pixels, free: Pixels, anyhow: bool = True) -> tuple[tuple[int, int], float]:
    """(x, y) of the pixel of `mask` farthest from its border and from what is not `free`, and that distance in px;
    `anyhow`: what is not free counts too where there is no room."""
    for candidate in (cv2.bitwise_and(mask, free), mask):
        padded = cv2.copyMakeBorder(candidate, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        _, radius, _, (x, y) = cv2.minMaxLoc(cv2.distanceTransform(padded, cv2.DIST_L2, 3))
        if radius > 1.5 or not anyhow:
            break
    return (x - 1, y - 1), float(radius)


@cache
def _font(size: int) -> PIL.ImageFont.FreeTypeFont | PIL.ImageFont.ImageFont:
    return PIL.ImageFont.load_default(size)


def _extent(label: _Label) -> tuple[float, float, float, float]:
    """x0, y0, x1, y1 panel px of a label with its halo."""
    ruler = PIL.ImageDraw.Draw(PIL.Image.new("RGB", (1, 1)))
    return ruler.textbbox(label.at, label.text, font=_font(label.size), anchor=label.anchor, stroke_width=HALO)


def _place(label: _Label, free: Pixels) -> _Label:
    """The label moved inside the panel; the place around it is no longer `free`."""
    x0, y0, x1, y1 = _extent(label)
    height, width = free.shape
    dx = max(0, 1 - x0) - max(0, x1 - width + 1)
    dy = max(0, 1 - y0) - max(0, y1 - height + 1)
    margin_x, margin_y = int(x1 - x0) // 2 + 2, int(y1 - y0) // 2 + 2  # half of a label of like size fits beside it
    row = slice(max(0, int(y0 + dy) - margin_y), max(0, int(y1 + dy) + margin_y))
    free[row, max(0, int(x0 + dx) - margin_x) : max(0, int(x1 + dx) + margin_x)] = 0
    return replace(label, at=(label.at[0] + dx, label.at[1] + dy))


def _write(panel: Pixels, labels: Sequence[_Label]) -> Pixels:
    picture = PIL.Image.fromarray(panel)
    draw = PIL.ImageDraw.Draw(picture)
    for label in labels:
        font = _font(label.size)
        draw.text(label.at, label.text, (255, 255, 255), font, label.anchor, stroke_width=HALO, stroke_fill=DARK)
    return np.asarray(picture)


def _assemble(panels: Sequence[Pixels], stacked: bool, title: str, crowded: bool) -> Pixels:
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
    font, small = _font(20), _font(15)
    draw.text((12, middle), title, (255, 255, 255), font, "lm")
    same = (
        "same colour: the same surface, numbered where there is room"
        if crowded
        else "same colour and number: the same surface"
    )
    legend = f"{same}      thin pale outline: not matched"
    if draw.textlength(title, font) + draw.textlength(legend, small) + 60 < width:
        draw.text((width - 12, middle), legend, PALE, small, "rm")
    return np.asarray(picture)
