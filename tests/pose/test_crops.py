"""Crops: what they show, and the exact way back."""

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from zpm2 import geometry
from zpm2.config import PoseConfig
from zpm2.model import Image, PointMatches, Polygon, PolygonArrays
from zpm2.pose import crops

SIDE = 64
CONFIG = PoseConfig(crop_size=SIDE)


def ramp(width: int, height: int) -> Image:
    """Red is the column of a pixel, green its row."""
    y, x = np.indices((height, width))
    return Image(np.dstack([x, y, 0 * x]).astype(np.uint8))


def boxes(*corners: tuple[float, float, float, float]) -> PolygonArrays:
    rings = [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64) for x0, y0, x1, y1 in corners]
    return PolygonArrays([Polygon(k, ring) for k, ring in enumerate(rings)])


@pytest.mark.parametrize("scale", [0.25, 1.0, 1.5, 3.0])
def test_a_crop_shows_what_its_matrix_says(scale: float) -> None:
    image = ramp(250, 240)
    matrix = np.array([[scale, 0, 30], [0, scale, 20], [0, 0, 1]])
    crop = crops.ImagePyramid(image, 0.25).crop(matrix, SIDE).rgb.astype(float)
    y, x = np.indices((SIDE, SIDE)) + 0.5
    expected = geometry.project(matrix, np.c_[x.ravel(), y.ravel()]).reshape(SIDE, SIDE, 2) - 0.5
    inner = (slice(4, -4), slice(4, -4))
    assert np.abs(crop[inner][..., :2] - expected[inner]).max() < 1.01  # 8 bits, and the half px of a reduced level


class Echo:
    """Finds the same crop px on both sides, and remembers the crops."""

    name = "echo"

    def __init__(self) -> None:
        self.seen: list[tuple[Image, Image]] = []

    def match(self, left: Image, right: Image) -> PointMatches:
        return self.match_many([(left, right)])[0]

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        self.seen += pairs
        at = np.array([[10.0, 12], [32, 32], [50, 20]])
        return [PointMatches(at, at, np.ones(3)) for _ in pairs]


def test_points_come_back_to_the_images() -> None:
    images = ramp(250, 200), ramp(250, 200)
    left, right = boxes((40, 40, 90, 80), (100, 100, 200, 160)), boxes((60, 50, 110, 90), (90, 100, 190, 160))
    echo = Echo()
    found = crops.match(crops.boxes(left, right, CONFIG), images, echo, CONFIG)
    assert len(echo.seen) == 2
    centers = np.array([[65, 60], [150, 130]]), np.array([[85, 70], [140, 130]])
    assert np.allclose(found.left[[1, 4]], centers[0])  # the middle of a crop is the middle of its box
    assert np.allclose(found.right[[1, 4]], centers[1])
    sizes = np.array([50, 100]) * (1 + 2 * CONFIG.crop_margin)
    assert np.allclose((found.left[[0, 3]] - centers[0]), (np.array([10, 12]) - 32) * sizes[:, None] / SIDE)


def test_small_boxes_are_not_enlarged_without_end() -> None:
    chosen = crops.boxes(boxes((40, 40, 52, 52)), boxes((40, 40, 52, 52)), CONFIG)
    assert chosen.left[0, 0, 0] == pytest.approx(1 / CONFIG.crop_max_zoom)
    assert len(crops.boxes(boxes((40, 40, 45, 80)), boxes((40, 40, 45, 80)), CONFIG).row) == 0


def test_rectified_crops_look_alike() -> None:
    """The right image is the left one turned by 90 degrees; the map says so."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (200, 200, 3)).astype(np.uint8), (0, 0), 2)
    left, right = Image(texture), Image(np.ascontiguousarray(np.rot90(texture, -1)))
    turn = np.array([[0, -1.0, 200], [1, 0, 0], [0, 0, 1]])
    a = boxes((60, 70, 120, 110))
    corners = geometry.project(turn, a.polygons[0].exterior)
    b = PolygonArrays([Polygon(0, corners)])
    chosen = crops.rectified(a, b, turn[None], np.ones(1), 0.1, dataclasses.replace(CONFIG, max_crops=5))
    echo = Echo()
    found = crops.match(chosen, (left, right), echo, CONFIG)
    one, other = (image.rgb.astype(float) for image in echo.seen[0])
    assert np.abs(one - other).mean() < 1.0
    assert np.allclose(geometry.project(turn, found.left), found.right)


def test_which_boxes_are_worth_a_crop() -> None:
    a = boxes((0, 0, 40, 40), (1, 1, 41, 41), (60, 60, 100, 100), (0, 0, 150, 150))
    maps = np.tile(np.eye(3), (4, 1, 1))
    confidence = np.array([0.5, 0.9, 0.4, 1.0])
    chosen = crops.rectified(a, a, maps, confidence, 0.5, dataclasses.replace(CONFIG, max_crops=10))
    assert chosen.row.tolist() == [1, 2]  # 0 is seen with 1, 3 was seen as large in the whole image
    assert crops.rectified(a, a, maps, confidence, 0.5, dataclasses.replace(CONFIG, max_crops=1)).row.tolist() == [1]
    mirrored = maps @ np.diag([-1.0, 1, 1])
    assert len(crops.rectified(a, a, mirrored, confidence, 0.5, dataclasses.replace(CONFIG, max_crops=10)).row) == 0


def test_nothing_matched() -> None:
    none = PolygonArrays([])
    chosen = crops.boxes(none, none, CONFIG)
    assert len(crops.match(chosen, (ramp(50, 50), ramp(50, 50)), Echo(), CONFIG)) == 0
    assert (
        len(
            crops.rectified(
                none, none, np.zeros((0, 3, 3)), np.zeros(0), 0.5, dataclasses.replace(CONFIG, max_crops=5)
            ).row
        )
        == 0
    )


def test_there_are_no_points_where_there_is_no_data() -> None:
    image = ramp(250, 240)
    valid = np.ones((240, 250), bool)
    valid[:, :65] = False
    chosen = crops.boxes(boxes((40, 40, 90, 80)), boxes((60, 50, 110, 90)), CONFIG)
    everywhere = crops.match(chosen, (image, image), Echo(), CONFIG)
    found = crops.match(chosen, (Image(image.rgb, valid=valid), image), Echo(), CONFIG)
    assert 0 < len(found) < len(everywhere)
    assert (found.left[:, 0] >= 65).all()
