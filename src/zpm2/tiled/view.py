"""One window of a photograph as the matcher sees it: reduced, and rotated if the photographs are rotated."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import TilesConfig
from zpm2.model import Image, Polygon
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.polygons.shapes import reshaped

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TileView:
    """The pixels of a window, and the map back to the photograph."""

    image: Image
    to_px: Array  # (3, 3) similarity: px of the photograph ~ to_px @ px of `image`

    @property
    def from_px(self) -> Array:
        """(3, 3) the inverse of `to_px`."""
        return np.asarray(np.linalg.inv(self.to_px))

    def points(self, points: Array) -> Array:
        """(n, 2) px of the view -> (n, 2) px of the photograph."""
        return geometry.project(self.to_px, points) if len(points) else points

    def polygon(self, polygon: Polygon, id: int) -> Polygon:
        """A polygon of the view in px of the photograph. Parents are not kept."""
        rings = [self.points(ring) for ring in (polygon.exterior, *polygon.holes)]
        return reshaped(replace(polygon, id=id, parent=None), shapely.Polygon(rings[0], rings[1:]))


def read_view(source: Source, window: Window, size: tuple[int, int], turn: float = 0.0) -> TileView:
    """The window reduced to `size` (width, height) px, and rotated by `turn` radians from x to y.

    The corners that the rotation leaves empty are marked as no data.
    """
    (x0, y0, x1, y1), (width, height) = window, size
    image = source.read(window, (width, height))
    to_px = np.array([[(x1 - x0) / width, 0, x0], [0, (y1 - y0) / height, y0], [0, 0, 1.0]])
    if not turn:
        return TileView(image, to_px)
    turned, whole = geometry.turn_image(width, height, turn)
    matrix = geometry.for_opencv(turned)[:2]
    rgb = cv2.warpAffine(image.rgb, matrix, whole, flags=cv2.INTER_LINEAR)
    valid = np.ones((height, width), np.uint8) if image.valid is None else image.valid.astype(np.uint8)
    seen = cv2.warpAffine(valid, matrix, whole, flags=cv2.INTER_NEAREST) > 0
    return TileView(Image(np.asarray(rgb, np.uint8), image.path, image.notes, seen), to_px @ np.linalg.inv(turned))


def applied_turn(turn: float, config: TilesConfig) -> float:
    """`turn` radians, or 0 if it is so small that the point matcher copes: the pixels are then not resampled."""
    return turn if abs(turn) > math.radians(config.min_turn) else 0.0


def reduced_size(window: Window, reduction: float) -> tuple[int, int]:
    """(width, height) px of a view with `reduction` px of the photograph (1 or more) for one of its own."""
    x0, y0, x1, y1 = window
    width, height = (max(1, round(side / max(reduction, 1.0))) for side in (x1 - x0, y1 - y0))
    return width, height
