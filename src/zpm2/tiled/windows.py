"""The windows of a large photograph that are processed, from all of it down to full resolution."""

import math

from zpm2.config import TilesConfig
from zpm2.photos.raster import Window


def levels(width: int, height: int, config: TilesConfig) -> list[list[Window]]:
    """The windows of each level for a photograph of `width` x `height` px, coarsest first.

    The first level is one window that shows the whole photograph. Later levels have square windows, `config.step` times
    smaller from level to level, down to `config.size` px. Windows are spread evenly and overlap by at least
    `config.overlap` of their side.
    """
    longest, sides = max(width, height), []
    side = config.size
    while side * config.min_tiles <= longest:
        sides.append(side)
        side *= config.step
    whole: Window = (0, 0, width, height)
    return [[whole], *(grid(width, height, side, config.overlap) for side in reversed(sides))]


def grid(width: int, height: int, side: int, overlap: float) -> list[Window]:
    """Windows of `side` px that cover the photograph, row by row; no longer than the photograph's own sides."""
    rows, columns = _starts(height, side, overlap), _starts(width, side, overlap)
    return [(x, y, min(x + side, width), min(y + side, height)) for y in rows for x in columns]


def area(window: Window) -> int:
    """px^2; 0 for an empty one."""
    x0, y0, x1, y1 = window
    return max(0, x1 - x0) * max(0, y1 - y0)


def side(window: Window) -> int:
    """px, the longer side."""
    return max(window[2] - window[0], window[3] - window[1])


def common(a: Window, b: Window) -> Window:
    """The rectangle that two windows share, perhaps empty."""
    return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


def _starts(length: int, side: int, overlap: float) -> list[int]:
    if length <= side:
        return [0]
    count = math.ceil((length - side) / (side * (1 - overlap))) + 1
    return [round(k * (length - side) / (count - 1)) for k in range(count)]
