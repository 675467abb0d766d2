"""A painted wall seen by several cameras: photographs whose regions correspond by known maps."""

from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2 import geometry

SIZE = (260, 190)  # (width, height) px
SETTINGS = [  # quick, and without weights
    *("points.escalate.on=false", "points.methods=sift", "device=cpu"),
    *("segment.model=classical", "segment.detail.level=off", "guided.direction=off"),
]
CENTERS = np.array([(x, y) for y in (60, 130, 200, 270) for x in (60, 140, 220, 300, 380)], float)  # of the shapes


def painting() -> NDArray[np.uint8]:
    """(330, 440, 3) coloured shapes on a textured wall."""
    rng = np.random.default_rng(5)
    coarse = cv2.resize(
        rng.integers(90, 150, (66, 88, 3)).astype(np.float32), (440, 330), interpolation=cv2.INTER_CUBIC
    )
    wall = np.clip(coarse, 0, 255)
    for k, (x, y) in enumerate(CENTERS):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 7))
        radius = rng.uniform(17, 30, 7)
        ring = np.c_[x + radius * np.cos(angles), y + radius * np.sin(angles)]
        color = cv2.cvtColor(np.array([[[k * 37 % 180, 230, 130 + 12 * (k % 10)]]], np.uint8), cv2.COLOR_HSV2RGB)[0, 0]
        mask = np.zeros(wall.shape[:2], np.uint8)
        cv2.fillPoly(mask, [np.rint(ring).astype(np.int32)], 1)
        grain = rng.normal(0, 12, (*wall.shape[:2], 1))
        wall = np.where(mask[..., None] > 0, np.clip(color.astype(float) + grain, 0, 255), wall)
    return wall.astype(np.uint8)


def view(number: int) -> NDArray[np.float64]:
    """(3, 3) from px of the painting to those of a photograph: it moves to the right and turns."""
    turn = np.radians(2.0 * number)
    about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return about @ np.array([[1, 0, -20.0 - 25 * number], [0, 1, -40.0 + 8 * number], [0, 0, 1]])


def photograph(number: int) -> NDArray[np.uint8]:
    """(190, 260, 3) what a camera sees."""
    return np.asarray(cv2.warpPerspective(painting(), view(number), SIZE, flags=cv2.INTER_LINEAR), np.uint8)


def on_wall(number: int, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) px of the painting that a photograph shows at a point (2,), px."""
    return geometry.project(np.linalg.inv(view(number)), point[None])[0]


def save_photographs(folder: Path, count: int = 4) -> list[Path]:
    """p0.png, p1.png, ..."""
    paths = [folder / f"p{k}.png" for k in range(count)]
    for k, path in enumerate(paths):
        PIL.Image.fromarray(photograph(k)).save(path)
    return paths
