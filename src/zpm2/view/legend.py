"""The lines above a picture: its title, and what its lines, colours and numbers mean."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import PIL.Image
import PIL.ImageDraw

from zpm2.view.labels import font
from zpm2.view.panel import PALE, WHITE, Color, Pixels, outline

HEADER = 68  # px, the height of a title and one line of keys
ROW = 26  # px, the height of each further line
MARGIN = 12  # px, left and right
SAMPLE = 30  # px, the width of a sample
APART = 20  # px between two entries
TITLES = (24, 20, 16, 13, 11)  # px, heights of type, of which the largest that fits is taken
TEXT = 16  # px, the height of the type below the title


@dataclass(frozen=True)
class Key:
    """An entry of the legend: a sample drawn as an outline with `dash`, filled, or none."""

    text: str
    color: Color | None = None
    dash: tuple[float, float] | None = None

    @property
    def width(self) -> int:
        """px, in the type of the legend."""
        return _length(self.text, TEXT) + (SAMPLE + 8 if self.color else 0)


@dataclass(frozen=True)
class Legend:
    """What is said above a picture."""

    title: str
    subject: str  # of the keys
    keys: Sequence[Key]
    remarks: Sequence[str]

    def height(self, width: int) -> int:
        """px that it needs above a picture of `width` px."""
        return HEADER + ROW * max(0, len(self._lines(width)) - 1)

    def draw(self, canvas: Pixels, height: int) -> Pixels:
        """The canvas with the legend over its upper `height` px, as many lines of it as fit there."""
        width = canvas.shape[1]
        texts = []
        for k, line in enumerate(self._lines(width)[: 1 + (height - HEADER) // ROW]):
            x, middle = MARGIN, 50 + ROW * k
            for key in line:
                if key.color:
                    _sample(canvas, key, x, middle)
                texts.append((x + (SAMPLE + 8 if key.color else 0), middle, key.text))
                x += key.width + APART
        picture = PIL.Image.fromarray(canvas)
        draw = PIL.ImageDraw.Draw(picture)
        size = next((s for s in TITLES if _length(self.title, s) + 2 * MARGIN <= width), TITLES[-1])
        draw.text((MARGIN, 22), self.title, WHITE, font(size), "lm")
        for x, middle, text in texts:
            draw.text((x, middle), text, PALE, font(TEXT), "lm")
        return np.asarray(picture)

    def _lines(self, width: int) -> list[list[Key]]:
        """The entries, as many in a line as fit."""
        lines: list[list[Key]] = []
        along = width
        for key in [*([Key(f"{self.subject}:")] if self.keys else []), *self.keys, *map(Key, self.remarks)]:
            if along + APART + key.width > width - MARGIN:
                lines.append([])
                along = MARGIN - APART
            lines[-1].append(key)
            along += APART + key.width
        return lines


def _sample(canvas: Pixels, key: Key, x: int, middle: int) -> None:
    assert key.color is not None
    if key.dash is None:
        cv2.rectangle(canvas, (x + 4, middle - 8), (x + SAMPLE - 2, middle + 8), key.color, -1)
        return
    corners = [(x, middle - 8), (x + SAMPLE, middle - 8), (x + SAMPLE, middle + 8), (x, middle + 8)]
    outline(canvas, [np.array(corners, np.int32) * 16], key.color, 2, key.dash)


def _length(text: str, size: int) -> int:
    return int(np.ceil(PIL.ImageDraw.Draw(PIL.Image.new("RGB", (1, 1))).textlength(text, font(size))))
