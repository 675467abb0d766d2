"""Views of photographs, reduced and turned, in which a matcher finds what it does not find in the photographs."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.model import Image, PointMatches


@dataclass(frozen=True, eq=False)
class View:
    """An image, reduced and turned. Nothing is cut off."""

    image: Image
    to_original: NDArray[np.float64]  # (3, 3) from px of the view to px of the original image


def view(image: Image, size: int, turn: float = 0.0) -> View:
    """The image with its longer side at `size` px, never enlarged, then turned by `turn` degrees from x to y."""
    factor = min(1.0, size / max(image.width, image.height))
    width, height = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    rgb: NDArray[np.uint8] = image.rgb
    if factor < 1:
        rgb = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA)
    turned, size_turned = geometry.turn_image(width, height, np.radians(turn))
    if turn:
        rgb = cv2.warpAffine(rgb, geometry.for_opencv(turned)[:2], size_turned, flags=cv2.INTER_LINEAR)
    scale = np.diag([image.width / width, image.height / height, 1.0])
    return View(Image(np.asarray(rgb, np.uint8)), scale @ np.linalg.inv(turned))


def to_originals(points: PointMatches, left: View, right: View) -> PointMatches:
    """Points of two views in px of their original images."""
    at_left, at_right = (
        geometry.project(left.to_original, points.left),
        geometry.project(right.to_original, points.right),
    )
    return PointMatches(at_left, at_right, points.score)
