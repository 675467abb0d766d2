"""Both photographs in one picture: what was matched, and what was not and why."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import SIDES, ImagePolygons, Polygon, PolygonMatch
from zpm2.view.labels import Label, labels_of, write
from zpm2.view.legend import HEADER, Key, Legend
from zpm2.view.palette import distinct_colors
from zpm2.view.panel import (
    CROWD,
    DARK,
    SOLID,
    WHITE,
    Color,
    PanelFrame,
    PanelRegion,
    Pixels,
    by_id,
    painted,
    region_of,
    rings_of,
    share,
)

SCREEN = 16 / 9  # aspect ratio, width / height, that the layout aims for
MAX_ENLARGEMENT = 2.0  # small photographs are shown up to this much larger, so that labels find room
READABLE = 480  # px, the side up to which tiny ones are enlarged more
GAP = 8  # px between the photographs
LEAST_WIDTH = 640  # px of the picture, for the legend
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


def overlay(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch], max_width: int = 2400
) -> Pixels:
    """(h, w, 3) uint8 RGB: the two photographs side by side, or one above the other where that fits a screen better.

    Matched polygons are filled and outlined in one colour and carry the id of their match in both photographs; the
    outline is solid, dashed or dotted by confidence (`STYLES`). Unmatched ones have a thin pale outline. Smaller
    polygons lie on top, larger ones are more transparent; where they overlap, a pixel has the colour of the topmost.
    A match has a number only if there is room for it in both photographs; the legend says how many have none.
    left, right: with their `image`, which may be reduced. max_width: the longest side of the result, px. The same input
    gives the same picture. `InputError` if a match names a polygon that does not exist, or an image is missing.
    """
    known = by_id(left.polygons, "left"), by_id(right.polygons, "right")
    for match in matches:
        if match.left not in known[0] or match.right not in known[1]:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
    styles = [next(n for n, (least, _, _) in enumerate(STYLES) if match.confidence >= least) for match in matches]
    used = {match.left for match in matches}, {match.right for match in matches}
    alone = len(left.polygons) - len(used[0]), len(right.polygons) - len(used[1])
    counts = Counter(styles)
    keys = [Key(f"{text}: {counts[n]}", WHITE, dash) for n, (_, dash, text) in enumerate(STYLES)] if matches else []
    legend = Legend(
        f"{_counted(len(matches), 'match', 'matches')} of {len(left.polygons)} left and {len(right.polygons)} right "
        "polygons",
        "confidence",
        keys,
        [
            "same colour: the same surface",
            "number: the match's id",
            f"thin pale outline: not matched ({alone[0]} left, {alone[1]} right)",
        ],
    )
    frames, stacked, reserved = _frames(left, right, max_width, legend, len(matches))
    pairs = [(known[0][match.left], known[1][match.right]) for match in matches]
    colors = distinct_colors(*_places([p for p, _ in pairs]))
    areas = [max(share(p, frames[0].full), share(q, frames[1].full)) for p, q in pairs]
    crowded = len(matches) > CROWD
    panels, labels = [], []
    for k, (frame, polygons) in enumerate(zip(frames, (left.polygons, right.polygons), strict=True)):
        matched = [
            region_of(pair[k], frame, areas[n], colors[n], str(matches[n].id), STYLES[styles[n]][1])
            for n, pair in enumerate(pairs)
        ]
        others = [ring for p in polygons if p.id not in used[k] for ring in rings_of(p, frame.scale)]
        panel, text = _panel(frame, matched, others, alone[k], crowded)
        panels.append(panel)
        labels.append(text)
    numbered = {label.text for label in labels[0]} & {label.text for label in labels[1]}
    names = {frame.name for frame in frames}
    labels = [[label for label in side if label.text in numbered | names] for side in labels]
    panels = [write(panel, side) for panel, side in zip(panels, labels, strict=True)]
    return _assemble(panels, stacked, _said(legend, len(matches) - len(numbered)), reserved)


def unmatched(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch], max_width: int = 2400
) -> Pixels:
    """(h, w, 3) uint8 RGB: the companion of `overlay`. It shows polygons without a partner, coloured by the reason.

    Polygons carry their own ids; matched ones have a thin pale outline. Layout and arguments are those of `overlay`.
    """
    used = {match.left for match in matches}, {match.right for match in matches}
    sides = left, right
    alone = [[p for p in side.polygons if p.id not in used[k]] for k, side in enumerate(sides)]
    why = [[sides[k].unmatched.get(p.id, UNKNOWN) for p in polygons] for k, polygons in enumerate(alone)]
    counts = Counter(why[0]), Counter(why[1])
    order = [*(name for name in REASONS if name in counts[0] | counts[1])]
    order += sorted((counts[0] | counts[1]).keys() - REASONS.keys())
    keys = [
        Key(f"{name}: {counts[0][name]} left, {counts[1][name]} right", REASONS.get(name, OTHER_REASON))
        for name in order
    ]
    legend = Legend(
        f"{len(alone[0])} of {len(left.polygons)} left and {len(alone[1])} of {len(right.polygons)} right polygons "
        "without a partner",
        "reason",
        keys,
        [
            "number: the polygon's id",
            f"thin pale outline: matched ({_counted(len(matches), 'pair', 'pairs')})",
        ],
    )
    frames, stacked, reserved = _frames(left, right, max_width, legend, len(alone[0]) + len(alone[1]))
    crowded = max(map(len, alone)) > CROWD
    panels, numbered = [], 0
    for k, frame in enumerate(frames):
        found = [
            region_of(p, frame, share(p, frame.full), REASONS.get(reason, OTHER_REASON), str(p.id))
            for p, reason in zip(alone[k], why[k], strict=True)
        ]
        others = [ring for p in sides[k].polygons if p.id in used[k] for ring in rings_of(p, frame.scale)]
        panel, labels = _panel(frame, found, others, len(used[k]), crowded)
        panels.append(write(panel, labels))
        numbered += sum(label.text != frame.name for label in labels)
    return _assemble(panels, stacked, _said(legend, len(alone[0]) + len(alone[1]) - numbered), reserved)


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _said(legend: Legend, left_out: int) -> Legend:
    """The legend with a remark on numbers for which there was no room."""
    if not left_out:
        return legend
    return replace(legend, remarks=[*legend.remarks, f"without a number, for lack of room: {left_out}"])


def _frames(
    left: ImagePolygons, right: ImagePolygons, max_side: int, legend: Legend, count: int
) -> tuple[list[PanelFrame], bool, tuple[int, int]]:
    """Both photographs with their places in the picture, whether they are stacked, and the legend's (width, height) px.

    count: of the numbers, of which the legend may have to say that they are left out.
    """
    if left.image is None or right.image is None:
        raise InputError("a photograph without its pixels cannot be drawn: give its `image`")
    images = left.image, right.image
    shapes = [(image.width, image.height) for image in images]
    header, width = HEADER, 0
    for _ in range(2):  # the legend's lines depend on the picture's width; more of them leave less room below
        sizes, stacked = _layout(shapes[0], shapes[1], max_side, header)
        both = [size[0] for size in sizes]
        width = max(width, max(both) if stacked else sum(both) + GAP, min(LEAST_WIDTH, max_side))
        header = min(_said(legend, count).height(width), max(HEADER, max_side // 3))
    frames = [
        PanelFrame(name, image, (side.width, side.height), size)
        for name, image, side, size in zip(SIDES, images, (left, right), sizes, strict=True)
    ]
    return frames, stacked, (width, header)


def _layout(
    left: tuple[int, int], right: tuple[int, int], max_side: int, header: int = HEADER
) -> tuple[tuple[tuple[int, int], tuple[int, int]], bool]:
    """(width, height) px of both panels, equal in height side by side or in width stacked, and whether stacked."""
    aspects = np.array([left[0] / left[1], right[0] / right[1]])
    beside, above = float(aspects.sum()), float(1 / (1 / aspects).sum())
    stacked = abs(math.log(above / SCREEN)) < abs(math.log(beside / SCREEN))
    common = 0 if stacked else 1  # the panels have one width, or one height
    shorter = max(left[common], right[common])
    largest = max(MAX_ENLARGEMENT * shorter, READABLE)
    if stacked:
        width = min(max_side, (max_side - header - GAP) * above, largest)
        sides = [(width, width / aspect) for aspect in aspects]
    else:
        height = min(max_side - header, (max_side - GAP) / beside, largest)
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


def _assemble(panels: Sequence[Pixels], stacked: bool, legend: Legend, reserved: tuple[int, int]) -> Pixels:
    """Both panels, in the middle, below the legend with its `reserved` (width, height) px."""
    width, header = reserved
    shape = np.array([panel.shape[:2] for panel in panels])
    step = (int(shape[0, 0]) + GAP, 0) if stacked else (0, int(shape[0, 1]) + GAP)
    height = int(shape[:, 0].sum()) + GAP if stacked else int(shape[:, 0].max())
    wide = int(shape[:, 1].max()) if stacked else int(shape[:, 1].sum()) + GAP
    canvas = np.empty((height + header, width, 3), np.uint8)
    canvas[:] = DARK
    for panel, (y, x) in zip(panels, ((0, 0), step), strict=True):
        top, start = header + y, (width - wide) // 2 + x
        canvas[top : top + panel.shape[0], start : start + panel.shape[1]] = panel
    return legend.draw(canvas, header)
