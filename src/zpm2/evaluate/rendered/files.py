"""Writes a rendered scene to files."""

from pathlib import Path

import cv2

from zpm2.evaluate.rendered.scene import RenderedScene
from zpm2.files.writing import atomic_write

NAMES = ("left.png", "right.png", "left_labels.png", "right_labels.png")


def save_scene(scene: RenderedScene, folder: Path) -> tuple[Path, Path]:
    """Write both photographs, and their true regions as label images. Returns the paths of the photographs."""
    photographs = [cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) for pixels in (scene.left, scene.right)]
    for name, pixels in zip(NAMES, (*photographs, scene.labels, scene.labels_right), strict=True):
        atomic_write(folder / name, cv2.imencode(".png", pixels)[1].tobytes())
    return folder / NAMES[0], folder / NAMES[1]
