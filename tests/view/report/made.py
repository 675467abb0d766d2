"""Results for the report: squares that moved, in two photographs of noise."""

import dataclasses

import cv2
import numpy as np

from zpm2.config import preset
from zpm2.errors import Failed
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult

SIDEWAYS = np.array([[0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # F of a rectified pair: rows stay rows
SHIFT = 12.0  # px that everything moves to the left
CELL, SQUARE = 40, 24  # px


def noise(seed: int, width: int, height: int) -> Image:
    grid = np.random.default_rng(seed).integers(40, 216, (height // 8, width // 8, 3), np.uint8)
    return Image(np.asarray(cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8))


def square(number: int, x: float, y: float, label: str | None = None, size: float = SQUARE) -> Polygon:
    ring = np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]])
    return Polygon(number, ring, score=0.9, label=label)


def made(
    columns: int = 8, rows: int = 5, label: str | None = None, path: str | None = None, cell: int = CELL
) -> MatchResult:
    """columns x rows squares; every fifth left one has no partner, and there is one more on the right."""
    width, height = columns * cell, rows * cell
    image = noise(1, width, height)
    moved = Image(np.roll(image.rgb, -round(SHIFT), axis=1))
    size = SQUARE * cell / CELL
    places = [(column * cell + 14, row * cell + 8) for row in range(rows) for column in range(columns)]
    left = [square(k, x, y, label, size) for k, (x, y) in enumerate(places)]
    kept = [k for k in range(len(places)) if k % 5]
    right = [square(1000 + k, places[k][0] - SHIFT, places[k][1], None, size) for k in kept]
    right.append(square(5000, width - size - 1, 0.5, None, size / 2))
    matches = [
        PolygonMatch(k, 1000 + k, 0.3 + 0.7 * (k % 7) / 6, 1 + k / 100, k, ("global", "local", "guided")[k % 3], 0.8)
        for k in kept
    ]
    lost = {k: ("outside overlap", "occluded", "no candidate", "rejected")[k // 5 % 4] for k in range(0, len(left), 5)}
    corners = np.array([[x, y] for x in (13.0, width - 1) for y in (1.0, height - 1)])
    points = PointMatches(corners, corners - (SHIFT, 0), np.ones(4))
    return MatchResult(
        ImagePolygons(width, height, left, path, image, unmatched=lost),
        ImagePolygons(width, height, right, path, moved, unmatched={5000: "no candidate"}),
        matches,
        points,
        SIDEWAYS,
        Failed("the scene is no plane"),
        dataclasses.asdict(preset("default")),
        {"read": 0.25, "local": 0.75},
        ["a warning"],
        ["a note"],
        "0.0",
        same_scene=0.875,
    )
