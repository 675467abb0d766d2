"""Numbers on the regions of a panel, none over another: inside the region, else beside it, else left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont
from numpy.typing import NDArray

from zpm2.view.panel import DARK, WHITE, PanelRegion, Pixels

MIN_LABEL, MAX_LABEL = 15, 28  # px, heights of the font of a number
NAME_LABEL = 16  # px, height of the font of the panel's name
HALO = 2  # px around text
SPACE = (6, 2)  # px left free between two labels, across and down: two numbers side by side must not read as one
INSIDE = 0.95  # share of a label's box on its region that is as good as all of it
MOSTLY = 0.55  # the least such share of a label in its region, in the smallest type
REACH = 16  # px from a region to a label beside it
DEEP, LEAD = 3, 50  # px that the line from a label leads into its region, where this is so wide within that distance
COVERABLE = 60  # px, the longer side from which on a region may lie below the number of one beside it

Box = tuple[int, int, int, int]  # x0, y0, x1, y1 panel px, end excluded


@dataclass(frozen=True)
class Label:
    """Text on a panel, white with a dark halo."""

    text: str
    box: Box  # that the text fills, with its halo
    size: int  # of the font, px
    tick: tuple[int, int] | None = None  # of a label beside its region: a pixel of this, to which a line leads


def labels_of(
    order: Sequence[PanelRegion], masks: Sequence[Pixels], owner: NDArray[np.int32], name: str, crowded: bool
) -> list[Label]:
    """The name of the panel, then the numbers of those regions that have room for one, in their `order`.

    masks: of each region within its box. owner: (h, w) the uppermost region of each pixel, -1 for none. Small regions
    choose first: a number stands deep in the visible part of its region, in type that follows the region's size. Then,
    unless the panel is crowded, those without room get theirs beside them, large ones first, where it hides no small
    region. In a crowd a number may cover tiny regions. No two labels overlap, and none leaves the panel.
    """
    taken = np.zeros(owner.shape, np.uint8)
    width, height, _, _ = _extent(name, NAME_LABEL)
    labels = []
    if 8 + width <= owner.shape[1] and 6 + height <= owner.shape[0]:
        labels.append(Label(name, (8, 6, 8 + width, 6 + height), NAME_LABEL))
        _take(taken, labels[0].box)
    tiny = np.array([crowded and region.side < MIN_LABEL for region in order] + [False])  # the last one: no region
    small = np.array([region.side < COVERABLE for region in order] + [False])
    found: dict[int, Label] = {}
    for k in reversed(range(len(order))):
        width, height, _, _ = _extent(order[k].label, MIN_LABEL)
        if cv2.countNonZero(masks[k]) < MOSTLY * width * height:
            continue
        window = _around(order[k].box, *_extent(order[k].label, MAX_LABEL)[:2], owner.shape)
        above = owner[window]
        seen = _within(masks[k], order[k].box, window) & ((above == k) | tiny[above])
        label = _inside(order[k].label, seen, taken[window], (window[1].start, window[0].start))
        if label is not None:
            found[k] = label
            _take(taken, label.box)
    for k in range(0 if crowded else len(order)):
        if k in found or not masks[k].any():
            continue
        width, height, _, _ = _extent(order[k].label, MIN_LABEL)
        window = _around(order[k].box, width + REACH, height + REACH, owner.shape)
        mask = _within(masks[k], order[k].box, window)
        blocked = taken[window] | small[owner[window]]
        corner = window[1].start, window[0].start
        seen = mask & (owner[window] == k)
        free = seen & (1 - taken[window])
        label = _beside(order[k].label, mask, free if free.any() else seen, blocked, corner)
        if label is not None:
            found[k] = label
            _take(taken, label.box)
    return labels + [found[k] for k in sorted(found)]


def _inside(text: str, seen: Pixels, taken: Pixels, origin: tuple[int, int]) -> Label | None:
    """The label where it is deepest in the `seen` pixels and not on `taken` ones, in the largest type that fits.

    Both are 0 or 1, of a window of the panel with its corner at `origin`.
    """
    depth = _depth(seen)
    largest = int(np.clip(0.9 * float(depth.max()), MIN_LABEL, MAX_LABEL))
    for size in (*range(largest, MIN_LABEL, -2), MIN_LABEL):
        width, height, _, _ = _extent(text, size)
        if width > seen.shape[1] or height > seen.shape[0]:
            continue
        least = MOSTLY if size == MIN_LABEL else INSIDE
        share = np.minimum(_sums(seen, width, height) / (width * height), INSIDE)
        share[_sums(taken, width, height) > 0] = 0
        best = float(share.max())
        if best >= least:
            deep = np.where(share == best, _centers(depth, width, height), -1)
            return _label(text, size, int(deep.argmax()), deep.shape[1], origin)
    return None


def _beside(text: str, mask: Pixels, seen: Pixels, blocked: Pixels, origin: tuple[int, int]) -> Label | None:
    """The label nearest to the region of `mask`, not on `blocked` pixels, with a line to what is `seen` of the region.

    All are 0 or 1, of a window of the panel with its corner at `origin`.
    """
    width, height, _, _ = _extent(text, MIN_LABEL)
    if width > mask.shape[1] or height > mask.shape[0]:
        return None
    away = _centers(cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3), width, height)
    away = np.where(_sums(blocked, width, height) > 0, np.inf, away)
    at = int(away.argmin())
    if away.ravel()[at] > REACH + np.hypot(width, height) / 2:
        return None
    label = _label(text, MIN_LABEL, at, away.shape[1], origin)
    depth = _depth(seen if seen.any() else mask)
    rows, columns = np.nonzero(depth)
    x, y = (np.array(label.box[:2]) + label.box[2:]) / 2 - origin
    far = np.hypot(columns - x, rows - y)
    deep = depth[rows, columns] >= DEEP
    nearest = int(np.where(deep & (far <= LEAD), far - LEAD, far).argmin())
    return replace(label, tick=(origin[0] + int(columns[nearest]), origin[1] + int(rows[nearest])))


def _depth(mask: Pixels) -> NDArray[np.float32]:
    """Distance of each pixel from the border of a mask of 0 and 1, which the border of the window is, too."""
    padded = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1], np.float32)


def _label(text: str, size: int, at: int, columns: int, origin: tuple[int, int]) -> Label:
    """at: number of the place of the upper left corner, by rows of `columns` places."""
    width, height, _, _ = _extent(text, size)
    x, y = origin[0] + at % columns, origin[1] + at // columns
    return Label(text, (x, y, x + width, y + height), size)


def _sums(mask: Pixels, width: int, height: int) -> NDArray[np.int32]:
    """Sums of `mask` over all boxes of a size, by their upper left corners."""
    table = cv2.integral(mask)
    found = table[height:, width:] - table[:-height, width:] - table[height:, :-width] + table[:-height, :-width]
    return np.asarray(found, np.int32)


def _centers(values: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """Values in the middle of all boxes of a size, by their upper left corners."""
    rows, columns = values.shape[0] - height + 1, values.shape[1] - width + 1
    return values[height // 2 : height // 2 + rows, width // 2 : width // 2 + columns]


def _around(box: Box, width: int, height: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of a panel of `shape` within so many px of a box."""
    x0, y0, x1, y1 = box
    return slice(max(0, y0 - height), min(shape[0], y1 + height)), slice(max(0, x0 - width), min(shape[1], x1 + width))


def _within(mask: Pixels, box: Box, window: tuple[slice, slice]) -> Pixels:
    """The mask of a box as 0 and 1 of a window that holds the box."""
    rows, columns = window
    seen = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
    x0, y0, x1, y1 = box
    seen[y0 - rows.start : y1 - rows.start, x0 - columns.start : x1 - columns.start] = mask > 0
    return seen


def _take(taken: Pixels, box: Box) -> None:
    x0, y0, x1, y1 = box
    taken[max(0, y0 - SPACE[1]) : y1 + SPACE[1], max(0, x0 - SPACE[0]) : x1 + SPACE[0]] = 1


@cache
def font(size: int) -> PIL.ImageFont.FreeTypeFont | PIL.ImageFont.ImageFont:
    """The font of all texts, `size` px high."""
    return PIL.ImageFont.load_default(size)


@cache
def _extent(text: str, size: int) -> tuple[int, int, int, int]:
    """Width and height px of a text with its halo, and where its origin lies in that box."""
    ruler = PIL.ImageDraw.Draw(PIL.Image.new("RGB", (1, 1)))
    x0, y0, x1, y1 = ruler.textbbox((0, 0), text, font(size), "ls", stroke_width=HALO)
    left, top = int(np.floor(x0)), int(np.floor(y0))
    return int(np.ceil(x1)) - left, int(np.ceil(y1)) - top, -left, -top


def write(panel: Pixels, labels: Sequence[Label]) -> Pixels:
    """The panel with its labels, and lines that lead from those beside their regions to these."""
    lines = np.array(panel)
    for color, width in ((DARK, 4), (WHITE, 1)):
        for label in labels:
            if label.tick:
                x0, y0, x1, y1 = label.box
                start = int(np.clip(label.tick[0], x0 + 4, x1 - 5)), int(np.clip(label.tick[1], y0 + 4, y1 - 5))
                cv2.line(lines, start, label.tick, color, width, cv2.LINE_AA)
                cv2.circle(lines, label.tick, width, color, -1, cv2.LINE_AA)
    picture = PIL.Image.fromarray(lines)
    draw = PIL.ImageDraw.Draw(picture)
    for label in labels:
        _, _, dx, dy = _extent(label.text, label.size)
        at = label.box[0] + dx, label.box[1] + dy
        draw.text(at, label.text, WHITE, font(label.size), "ls", stroke_width=HALO, stroke_fill=DARK)
    return np.asarray(picture)
