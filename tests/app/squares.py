"""Two photographs of plain squares on a rough ground that moved sideways, and how to look at them without weights."""

from pathlib import Path

import cv2
import numpy as np
import PIL.Image

from zpm2.app.pair import Pair
from zpm2.app.photograph import read
from zpm2.config import Config, preset, with_options
from zpm2.model import Image
from zpm2.pipeline import PairMatcher

WIDTH, HEIGHT, SHIFT = 320, 240, 12  # px; everything moves to the left
PLACES = ((60, 60), (170, 50), (110, 150), (230, 140))  # px, corners of the squares
SIDE = 50  # px
COLORS = ((200, 30, 30), (30, 180, 40), (40, 60, 220), (230, 200, 30))
QUICK = {"segmenter": "classical", "points": "sift", "device": "cpu"}


def photographs() -> tuple[Image, Image]:
    """Left and right."""
    rough = np.random.default_rng(5).integers(60, 196, (HEIGHT // 4, (WIDTH + SHIFT) // 4, 3), np.uint8)
    wide = np.asarray(cv2.resize(rough, (WIDTH + SHIFT, HEIGHT), interpolation=cv2.INTER_CUBIC), np.uint8)
    for (x, y), color in zip(PLACES, COLORS, strict=True):
        wide[y : y + SIDE, x : x + SIDE] = color
    return Image(wide[:, :WIDTH].copy()), Image(wide[:, SHIFT:].copy())


def square(number: int, side: int = 0) -> list[list[list[list[float]]]]:
    """The outline of a square, as the page sends it."""
    x, y = PLACES[number][0] - SHIFT * side, PLACES[number][1]
    return [[[[x, y], [x + SIDE, y], [x + SIDE, y + SIDE], [x, y + SIDE]]]]


def quick() -> Config:
    return with_options(preset("default"), QUICK)


def pair(config: Config | None = None) -> Pair:
    config = config or quick()
    left, right = photographs()
    sides = read(left, "left.png", "left", config), read(right, "right.png", "right", config)
    return Pair(sides, PairMatcher(config), lambda stage, share: None)


def save(folder: Path) -> tuple[Path, Path]:
    """Both as files."""
    files = folder / "left.png", folder / "right.png"
    for file, image in zip(files, photographs(), strict=True):
        PIL.Image.fromarray(image.rgb).save(file)
    return files
