"""Both photographs in one picture: what was matched, and what was not and why."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import PIL.Image
import PIL.ImageDraw
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import SIDES, ImagePolygons, Polygon, PolygonMatch
from zpm2.view.palette import distinct_colors
from zpm2.view.panel import (
    CROWD,
    DARK,
    PALE,
    SOLID,
    Color,
    Label,
    PanelFrame,
    PanelRegion,
    Pixels,
    by_id,
    font,
    labels_of,
    outline,
    painted,
    region_of,
    rings_of,
    share,
    write,
)

SCREEN = 16 / 9  # aspect ratio, width / height, that the layout aims for
MAX_ENLARGEMENT = 2.0  # small photographs are shown up to this much larger, so that labels find room
GAP = 8  # px between the photographs
HEADER = 68  # px: a title, and below it what the lines and colours mean
KEY_WIDTH = 30  # px, the width of a sample in the header
WHITE = (255, 255, 255)
STYLES = ((0.9, SOLID, "0.9 and more"), (0.7, (7.0, 8.0), "0.7 to 0.9"), (0.0, (1.0, 5.0), "less"))  # by confidence
REASONS: Mapping[str, Color] = {
    "outside overlap": (86, 180, 233),
    "occluded": (214, 121, 188),
    "no candidate": (240, 228, 66),
    "rejected": (235, 88, 28),
}
OTHER_REASON = (170, 170, 170)  # of any other reason
UNKNOWN = "reason not known"

Ring = NDArray[np.int32]


@dataclass(frozen=True)
class _Key:
    """An entry of the legend: a sample drawn as an outline with `dash`, or filled."""

    text: str
    color: Color
    dash: tuple[float, float] | None = None


def overlay(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch], max_width: int = 2400
) -> Pixels:
    """(h, w, 3) uint8 RGB: the two photographs side by side, or one above the other where that fits a screen better.

    Matched polygons are filled and outlined in one colour and carry the id of their match in both photographs; the
    outline is solid, dashed or dotted by confidence (`STYLES`). Unmatched ones have a thin pale outline. Smaller
    polygons lie on top, larger ones are more transparent; where they overlap, a pixel has the colour of the topmost.
    With more than `CROWD` matches, a match has a number only if there is room for it in both photographs.
    left, right: with their `image`, which may be reduced. max_width: the longest side of the result, px. The same input
    gives the same picture. `InputError` if a match names a polygon that does not exist, or an image is missing.
    """
    known = by_id(left.polygons, "left"), by_id(right.polygons, "right")
    for match in matches:
        if match.left not in known[0] or match.right not in known[1]:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
    frames, stacked = _frames(left, right, max_width)
    pairs = [(known[0][match.left], known[1][match.right]) for match in matches]
    colors = distinct_colors(*_places([p for p, _ in pairs]))
    areas = [max(share(p, frames[0].full), share(q, frames[1].full)) for p, q in pairs]
    styles = [next(n for n, (least, _, _) in enumerate(STYLES) if match.confidence >= least) for match in matches]
    crowded = len(matches) > CROWD
    panels, labels = [], []
    for k, (frame, polygons) in enumerate(zip(frames, (left.polygons, right.polygons), strict=True)):
        matched = [
            region_of(pair[k], frame, areas[n], colors[n], str(matches[n].id), STYLES[styles[n]][1])
            for n, pair in enumerate(pairs)
        ]
        used = {pair[k].id for pair in pairs}
        others = [ring for p in polygons if p.id not in used for ring in rings_of(p, frame.scale)]
        panel, text = _panel(frame, matched, others, len(polygons) - len(used), crowded)
        panels.append(panel)
        labels.append(text)
    if crowded:
        both = {label.text for label in labels[0]} & {label.text for label in labels[1]} | {"left", "right"}
        labels = [[label for label in side if label.text in both] for side in labels]
    panels = [write(panel, side) for panel, side in zip(panels, labels, strict=True)]
    count = f"{len(matches)} {'match' if len(matches) == 1 else 'matches'}"
    title = f"{count} of {len(left.polygons)} left and {len(right.polygons)} right polygons"
    where = ", where there is room" if crowded else ""
    remark = f"same colour: the same surface      number: the match's id{where}      thin pale outline: not matched"
    counts = Counter(styles)
    keys = [_Key(f"{text}: {counts[n]}", WHITE, dash) for n, (_, dash, text) in enumerate(STYLES)]
    return _assemble(panels, stacked, title, remark, "confidence", keys if matches else [])


def unmatched(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch], max_width: int = 2400
) -> Pixels:
    """(h, w, 3) uint8 RGB: the companion of `overlay`. It shows polygons without a partner, coloured by the reason.

    Polygons carry their own ids; matched ones have a thin pale outline. Layout and arguments are those of `overlay`.
    """
    frames, stacked = _frames(left, right, max_width)
    used = {match.left for match in matches}, {match.right for match in matches}
    sides = left, right
    alone = [[p for p in side.polygons if p.id not in used[k]] for k, side in enumerate(sides)]
    why = [[sides[k].unmatched.get(p.id, UNKNOWN) for p in polygons] for k, polygons in enumerate(alone)]
    crowded = max(map(len, alone)) > CROWD
    panels = []
    for k, frame in enumerate(frames):
        found = [
            region_of(p, frame, share(p, frame.full), REASONS.get(reason, OTHER_REASON), str(p.id))
            for p, reason in zip(alone[k], why[k], strict=True)
        ]
        others = [ring for p in sides[k].polygons if p.id in used[k] for ring in rings_of(p, frame.scale)]
        panels.append(write(*_panel(frame, found, others, len(used[k]), crowded)))
    counts = Counter(why[0]), Counter(why[1])
    order = [*(name for name in REASONS if name in counts[0] | counts[1])]
    order += sorted((counts[0] | counts[1]).keys() - REASONS.keys())
    keys = [
        _Key(f"{name}: {counts[0][name]} left, {counts[1][name]} right", REASONS.get(name, OTHER_REASON))
        for name in order
    ]
    title = f"{len(alone[0])} of {len(left.polygons)} left and {len(alone[1])} of {len(right.polygons)} right polygons "
    return _assemble(
        panels,
        stacked,
        title + "without a partner",
        f"number: the polygon's id{', where there is room' if crowded else ''}      thin pale outline: matched",
        "reason",
        keys,
    )


def _frames(left: ImagePolygons, right: ImagePolygons, max_side: int) -> tuple[list[PanelFrame], bool]:
    """Both photographs with their places in the picture, and whether they are stacked."""
    if left.image is None or right.image is None:
        raise InputError("a photograph without its pixels cannot be drawn: give its `image`")
    images = left.image, right.image
    (a, b), (c, d) = ((image.width, image.height) for image in images)
    sizes, stacked = _layout((a, b), (c, d), max_side)
    frames = [
        PanelFrame(name, image, (side.width, side.height), size)
        for name, image, side, size in zip(SIDES, images, (left, right), sizes, strict=True)
    ]
    return frames, stacked


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


def _panel(
    frame: PanelFrame, regions: Sequence[PanelRegion], others: Sequence[Ring], count: int, crowded: bool
) -> tuple[Pixels, list[Label]]:
    """A photograph with its regions, small ones on top, and the labels that are still to be written on it."""
    order = sorted(regions, key=lambda region: -region.area)
    panel, masks, owner = painted(frame, order, others, count, crowded)
    return panel, labels_of(order, masks, owner, frame.name, crowded)


def _assemble(
    panels: Sequence[Pixels], stacked: bool, title: str, remark: str, subject: str, keys: Sequence[_Key]
) -> Pixels:
    """Both panels below a header."""
    shape = np.array([panel.shape[:2] for panel in panels])
    step = (int(shape[0, 0]) + GAP, 0) if stacked else (0, int(shape[0, 1]) + GAP)
    height = int(shape[:, 0].sum()) + GAP if stacked else int(shape[:, 0].max())
    width = int(shape[:, 1].max()) if stacked else int(shape[:, 1].sum()) + GAP
    canvas = np.empty((height + HEADER, width, 3), np.uint8)
    canvas[:] = DARK
    for panel, (y, x) in zip(panels, ((0, 0), step), strict=True):
        canvas[HEADER + y : HEADER + y + panel.shape[0], x : x + panel.shape[1]] = panel
    return _headed(canvas, title, remark, subject, keys)


def _headed(canvas: Pixels, title: str, remark: str, subject: str, keys: Sequence[_Key]) -> Pixels:
    """The title with a remark beside it where that fits, and a line of keys in the largest type that fits."""
    width = canvas.shape[1]
    ruler = PIL.ImageDraw.Draw(PIL.Image.new("RGB", (1, 1)))
    size = next((s for s in (24, 20, 16, 13) if ruler.textlength(title, font(s)) + 24 < width), 11)
    small = next((s for s in (18, 15, 13) if sum(_widths(subject, keys, s)) + 24 < width), 11)
    middle, along, texts = 50, 12.0, []
    for key, room in zip([None, *keys], _widths(subject, keys, small), strict=True):
        texts.append((along + (KEY_WIDTH + 6 if key else 0), key.text if key else f"{subject}:"))
        x = int(along)
        if key is not None and key.dash is None:
            cv2.rectangle(canvas, (x + 8, middle - 8), (x + KEY_WIDTH - 2, middle + 8), key.color, -1)
        elif key is not None and key.dash is not None:
            box = np.array(
                [[x, middle - 8], [x + KEY_WIDTH, middle - 8], [x + KEY_WIDTH, middle + 8], [x, middle + 8]], np.int32
            )
            outline(canvas, [box * 16], key.color, 2, key.dash)
        along += room
    picture = PIL.Image.fromarray(canvas)
    draw = PIL.ImageDraw.Draw(picture)
    draw.text((12, 24), title, WHITE, font(size), "lm")
    if draw.textlength(title, font(size)) + draw.textlength(remark, font(small)) + 60 < width:
        draw.text((width - 12, 24), remark, PALE, font(small), "rm")
    for at, text in texts if keys else []:  # no keys: nothing to explain
        draw.text((at, middle), text, PALE, font(small), "lm")
    return np.asarray(picture)


def _widths(subject: str, keys: Sequence[_Key], size: int) -> list[float]:
    """Widths of the subject and of each key in the line, px."""
    ruler = PIL.ImageDraw.Draw(PIL.Image.new("RGB", (1, 1)))
    texts = [f"{subject}:", *(key.text for key in keys)]
    return [ruler.textlength(text, font(size)) + 18 + (KEY_WIDTH + 6 if k else 0) for k, text in enumerate(texts)]
