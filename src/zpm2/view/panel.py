"""One photograph, muted, with coloured regions: one half of a picture of a result. `labels` numbers them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Image, Polygon

Pixels = NDArray[np.uint8]
Color = tuple[int, int, int]

CROWD = 300  # with more regions than this, small ones have thin outlines, and none has a number beside it
SMALL_REGION = 24  # px, the longer side of such a region
PALE_CROWD = 3000  # pale outlines of one photograph; more are fainter
FAINTEST = 0.2  # 0..1 of the outlines' strength
SOLID = (1.0, 0.0)  # px drawn and px left out, alternating along an outline
DARK = (24, 24, 27)
PALE = (214, 214, 214)
WHITE = (255, 255, 255)


@dataclass(frozen=True)
class PanelFrame:
    """A photograph and its place in a picture."""

    name: str
    image: Image  # of any size
    full: tuple[int, int]  # width, height px of the photograph, which coordinates of polygons are in
    size: tuple[int, int]  # width, height px of the panel

    @property
    def scale(self) -> NDArray[np.float64]:
        """(2,) panel px per px of the photograph."""
        return np.array(self.size) / self.full


@dataclass(frozen=True)
class PanelRegion:
    """A polygon on its panel."""

    rings: list[NDArray[np.int32]]  # OpenCV points in 1/16 px, pixel centres at 0: exterior, then holes
    box: tuple[int, int, int, int]  # x0, y0, x1, y1 panel px, end excluded
    area: float  # share of the photograph, of the larger one of a matched pair
    color: Color
    label: str
    dash: tuple[float, float] = SOLID

    @property
    def side(self) -> int:
        """The longer side of the box, px."""
        x0, y0, x1, y1 = self.box
        return max(x1 - x0, y1 - y0)


def by_id(polygons: Sequence[Polygon], side: str) -> Mapping[int, Polygon]:
    """The polygons by their ids; `InputError` where two have the same."""
    table = {p.id: p for p in polygons}
    if len(table) != len(polygons):
        raise InputError(f"two {side} polygons have the same id: number them first")
    return table


def share(polygon: Polygon, size: tuple[int, int]) -> float:
    """Area of a polygon as a share of its photograph, which has `size` (width, height) px."""
    return polygon.area / (size[0] * size[1])


def rings_of(polygon: Polygon, scale: NDArray[np.float64]) -> list[NDArray[np.int32]]:
    """Exterior, then holes, as OpenCV points of the panel in 1/16 px; scale: (2,) panel px per px."""
    return [np.rint((ring * scale - 0.5) * 16).astype(np.int32) for ring in (polygon.exterior, *polygon.holes)]


def region_of(
    polygon: Polygon,
    frame: PanelFrame,
    area: float,
    color: Color,
    label: str,
    dash: tuple[float, float] = SOLID,
) -> PanelRegion:
    """A polygon on the panel of its photograph; for the rest see `PanelRegion`."""
    scale = frame.scale
    low = np.clip(np.floor(polygon.exterior.min(0) * scale), 0, frame.size).astype(int)
    high = np.clip(np.ceil(polygon.exterior.max(0) * scale) + 1, 0, frame.size).astype(int)
    box = int(low[0]), int(low[1]), int(high[0]), int(high[1])
    return PanelRegion(rings_of(polygon, scale), box, area, color, label, dash)


def painted(
    frame: PanelFrame,
    order: Sequence[PanelRegion],
    others: Sequence[NDArray[np.int32]],
    count: int,
    crowded: bool,
) -> tuple[Pixels, list[Pixels], NDArray[np.int32]]:
    """One photograph, muted, with its regions, in `order`, and the pale rings of its `count` others.

    A pixel only has the colour of the uppermost region that covers it: colours never mix. Also returns the mask of each
    region within its box, and (h, w) the uppermost region of each pixel, -1 for none.
    """
    shrink = frame.size[0] < frame.image.width
    rgb = cv2.resize(frame.image.rgb, frame.size, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_CUBIC)
    gray = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    panel = cv2.addWeighted(rgb, 0.35, gray, 0.5, 0)
    owner = np.full(panel.shape[:2], -1, np.int32)
    masks = []
    for k, region in enumerate(order):
        x0, y0, x1, y1 = region.box
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        masks.append(mask)
        if mask.size:
            cv2.fillPoly(mask, [ring - np.array([x0 * 16, y0 * 16], np.int32) for ring in region.rings], 255, shift=4)
            owner[y0:y1, x0:x1][mask > 0] = k
    _fill(panel, owner, order)
    outlined = cv2.polylines(panel.copy(), others, True, PALE, 1, cv2.LINE_AA, shift=4)
    strength = max(FAINTEST, min(1.0, PALE_CROWD / max(count, 1)))
    panel = cv2.addWeighted(outlined, strength, panel, 1 - strength, 0) if strength < 1 else outlined
    for region in order:
        small = crowded and region.side < SMALL_REGION
        if not small:
            cv2.polylines(panel, region.rings, True, DARK, 4, cv2.LINE_AA, shift=4)
        outline(panel, region.rings, region.color, 1 if small else 2, region.dash)
    return panel, masks, owner


def _fill(panel: Pixels, owner: NDArray[np.int32], order: Sequence[PanelRegion]) -> None:
    """Each pixel in the colour of its owner; large regions let more of the photograph through."""
    share = np.sqrt([region.area for region in order])
    alpha = np.append(np.interp(share, (0.05, 0.5), (0.6, 0.3)), 0.0).astype(np.float32)  # the last one: of no region
    color = np.array([*(region.color for region in order), (0, 0, 0)], np.float32)
    for rows in range(0, len(panel), 256):
        part, top = panel[rows : rows + 256], owner[rows : rows + 256]
        a = alpha[top][..., None]
        part[:] = np.rint(part * (1 - a) + color[top] * a).astype(np.uint8)


def outline(
    panel: Pixels, rings: Sequence[NDArray[np.int32]], color: Color, width: int, dash: tuple[float, float]
) -> None:
    """Draw closed lines, with `dash` px drawn and left out alternately."""
    if dash == SOLID:
        cv2.polylines(panel, rings, True, color, width, cv2.LINE_AA, shift=4)
        return
    for ring in rings:
        pieces = dashes(ring / 16, dash)
        cv2.polylines(panel, list(np.rint(pieces * 16).astype(np.int32)), False, color, width, cv2.LINE_AA, shift=4)


def dashes(ring: NDArray[np.float64], dash: tuple[float, float]) -> NDArray[np.float64]:
    """(n, 2) a closed line -> (m, 2, 2) the straight pieces of it that are drawn, ends in the line's order."""
    closed = np.concatenate([ring, ring[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    turns = max(1, round(along[-1] / sum(dash)))  # whole ones, so that the ends meet as the others do
    period = along[-1] / turns
    starts = np.arange(turns) * period
    cuts = np.unique(np.concatenate([along, starts, starts + period * dash[0] / sum(dash)]))
    middle = (cuts[:-1] + cuts[1:]) / 2
    drawn = middle % period < period * dash[0] / sum(dash) if period else np.zeros(len(middle), bool)
    ends = np.stack([np.interp(cuts, along, closed[:, k]) for k in range(2)], axis=1)
    return np.stack([ends[:-1], ends[1:]], axis=1)[drawn]
