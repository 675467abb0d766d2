"""A large photograph at full size for the page: files beside it, of which the page loads those that it shows."""

from collections.abc import Iterator

import cv2

from zpm2.photos.source import Source

SIDE = 1024  # px of a tile
QUALITY = 85  # 1..100, JPEG


def levels(width: int, height: int, longest: int) -> int:
    """How many levels have more pixels than a picture of at most `longest` px: the photograph, its half, its quarter,
    and so on."""
    count = 0
    while max(width, height) > longest * 2**count:
        count += 1
    return count


def tiles(source: Source, count: int) -> Iterator[tuple[str, bytes]]:
    """Name and content of each tile of `count` levels, as `LEVEL-COLUMN-ROW.jpg`; level 0 is the photograph itself.

    Only one tile at a time is in memory.
    """
    for level in range(count):
        span = SIDE * 2**level
        for row, y0 in enumerate(range(0, source.height, span)):
            for column, x0 in enumerate(range(0, source.width, span)):
                x1, y1 = min(x0 + span, source.width), min(y0 + span, source.height)
                size = max(1, (x1 - x0) >> level), max(1, (y1 - y0) >> level)
                pixels = cv2.cvtColor(source.read((x0, y0, x1, y1), size).rgb, cv2.COLOR_RGB2BGR)
                packed = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
                yield f"{level}-{column}-{row}.jpg", packed.tobytes()
