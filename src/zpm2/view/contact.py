"""Many matches in one picture, each as a pair of crops, to judge them by eye."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont
from numpy.typing import NDArray

from zpm2.model import Image
from zpm2.view.panel import DARK, PALE, Pixels

BRIGHT = (255, 225, 0)  # outlines
CAPTION = 20  # px below the crops
SEAM = 2  # px between the crops of a match
GAP = 10  # px between matches and around them
MIN_MARGIN = 16  # px, the narrowest margin of a window


@dataclass(frozen=True, eq=False)
class Crop:
    """One side of a match."""

    image: Image  # pixels around the polygon
    rings: list[NDArray[np.float64]]  # (n, 2) px of `image`, pixel centres at +0.5: exterior, then holes


def crop_window(
    bounds: tuple[float, float, float, float], width: int, height: int, margin: float = 0.6
) -> tuple[int, int, int, int]:
    """(x0, y0, x1, y1) px, end excluded: the square around a polygon.

    The margin on each side is `margin` times the polygon's longer side, but at least `MIN_MARGIN` px.

    bounds: (x_min, y_min, x_max, y_max) of the polygon, px of an image of width x height px. At a border the window is
    moved into the image, and stays a square unless the image is too narrow for it.
    """
    longer = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    side = math.ceil(longer + 2 * max(margin * longer, MIN_MARGIN))
    spans = []
    for low, high, length in ((bounds[0], bounds[2], width), (bounds[1], bounds[3], height)):
        size = min(side, length)
        start = min(max(round((low + high - size) / 2), 0), length - size)
        spans.append((start, start + size))
    (x0, x1), (y0, y1) = spans
    return x0, y0, x1, y1


def contact_sheet(rows: Sequence[Sequence[Crop]], captions: Sequence[str], side: int = 150, columns: int = 5) -> Pixels:
    """(h, w, 3) uint8 RGB: a cell for each row, its crops (as many in each) side by side and its caption below.

    Each crop fills a square of `side` px as far as its aspect allows, with the polygon's outline over it. Cells go from
    left to right, `columns` (>= 1) of them in a line; captions that are too long are cut. The same input gives the same
    picture. `ValueError` unless there are as many captions as rows.
    """
    font = PIL.ImageFont.load_default(13)
    columns = max(1, min(columns, len(rows)))
    wide = max(map(len, rows), default=2) * (side + SEAM) - SEAM  # px, all crops of a row
    cell = np.array([wide + GAP, side + CAPTION + GAP])  # width, height with the gap after it
    lines = max(1, math.ceil(len(rows) / columns))
    canvas = np.empty((lines * int(cell[1]) + GAP, columns * int(cell[0]) + GAP, 3), np.uint8)
    canvas[:] = DARK
    corners = [(GAP + k % columns * int(cell[0]), GAP + k // columns * int(cell[1])) for k in range(len(rows))]
    for (x, y), row in zip(corners, rows, strict=True):
        for k, crop in enumerate(row):
            left = x + k * (side + SEAM)
            canvas[y : y + side, left : left + side] = _square(crop, side)
    picture = PIL.Image.fromarray(canvas)
    draw = PIL.ImageDraw.Draw(picture)
    for (x, y), caption in zip(corners, captions, strict=True):
        text = _shortened(caption, draw, font, wide)
        draw.text((x + wide / 2, y + side + CAPTION / 2), text, PALE, font, "mm")
    if not rows:
        draw.text((picture.width / 2, picture.height / 2), "no matches", PALE, font, "mm")
    return np.asarray(picture)


def _square(crop: Crop, side: int) -> Pixels:
    """(side, side, 3) the crop in the middle, with its outline."""
    image = crop.image
    factor = side / max(image.width, image.height)
    size = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    pixels = cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
    scale = np.array(size) / (image.width, image.height)
    rings = [np.rint((ring * scale - 0.5) * 16).astype(np.int32) for ring in crop.rings]
    cv2.polylines(pixels, rings, True, DARK, 3, cv2.LINE_AA, shift=4)
    cv2.polylines(pixels, rings, True, BRIGHT, 1, cv2.LINE_AA, shift=4)
    square = np.empty((side, side, 3), np.uint8)
    square[:] = DARK
    x, y = (side - size[0]) // 2, (side - size[1]) // 2
    square[y : y + size[1], x : x + size[0]] = pixels
    return square


def _shortened(
    text: str,
    draw: PIL.ImageDraw.ImageDraw,
    font: PIL.ImageFont.FreeTypeFont | PIL.ImageFont.ImageFont,
    width: int,
) -> str:
    """As much of a text as fits into `width` px."""
    if draw.textlength(text, font) <= width:
        return text
    while text and draw.textlength(text + "...", font) > width:
        text = text[:-1]
    return text + "..."
