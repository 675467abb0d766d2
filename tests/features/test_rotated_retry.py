"""A second search: made where the first one finds few points, and only there; its points are where they belong."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from test_point_matchers import build, config, texture, warped

from zpm2.config import PointsConfig, RotatedRetryConfig
from zpm2.features import create
from zpm2.features.rotated_retry import RotatedRetry, _view, both_ways
from zpm2.geometry import project
from zpm2.model import Image, PointMatches


@pytest.mark.parametrize("angle", [0, 45, -135, 90, 180])
@pytest.mark.parametrize("size", [80, 160, 500])
def test_a_view_shows_what_its_matrix_says(angle: int, size: int) -> None:
    """A picture of two ramps: red is the column, green the row."""
    y, x = np.indices((120, 160))
    image = Image(np.dstack([x, y, 0 * x]).astype(np.uint8))
    view, to_image = _view(image, size, angle)
    height, width = view.rgb.shape[:2]
    rows, columns = np.indices((height, width)) + 0.5
    at = project(to_image, np.c_[columns.ravel(), rows.ravel()]).reshape(height, width, 2)
    inner = ((at > 4) & (at < [156, 116])).all(2)
    assert inner.sum() > 0.6 * 160 * 120 * min(1, size / 160) ** 2
    assert np.abs(view.rgb[inner][:, :2] - (at[inner] - 0.5)).max() < 1.51
    corners = project(np.linalg.inv(to_image), np.array([[0.0, 0], [160, 0], [160, 120], [0, 120]]))
    assert corners.min() > -1e-6
    assert (corners < np.array([width, height]) + 1e-6).all()


class Counting:
    """Finds `n` points of a plane, and counts how often it is called."""

    name = "counting"

    def __init__(self, n: int) -> None:
        self.n, self.asked, self.retried = n, 0, 0

    def match(self, left: Image, right: Image) -> PointMatches:
        self.asked += 1
        rng = np.random.default_rng(0)
        at = rng.uniform(5, 800, (self.n, 2))
        depth = rng.uniform(5, 30, self.n)
        return PointMatches(at, at + np.c_[depth, 0 * depth], np.ones(self.n))

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        self.retried += len(pairs)
        return [PointMatches.empty() for _ in pairs]


@pytest.mark.parametrize(("points", "retried"), [(1000, 0), (300, 0), (150, 6), (50, 16), (0, 16)])
def test_it_searches_as_often_as_it_must(points: int, retried: int) -> None:
    matcher = Counting(points)
    image = Image(np.zeros((900, 1300, 3), np.uint8))
    found = RotatedRetry(matcher, lambda: matcher, 1600, RotatedRetryConfig()).match(image, image)
    assert (matcher.asked, matcher.retried) == (1, retried)
    assert len(found) == points


def test_a_small_image_is_searched_once_a_turn() -> None:
    matcher = Counting(0)
    image = Image(np.zeros((300, 400, 3), np.uint8))
    RotatedRetry(matcher, lambda: matcher, 1600, RotatedRetryConfig()).match(image, image)
    assert matcher.retried == 8


def test_it_is_asked_for_by_the_configuration() -> None:
    assert isinstance(create(PointsConfig(methods=("sift",), rotated_retry=True)), RotatedRetry)
    assert not isinstance(create(PointsConfig(methods=("sift",))), RotatedRetry)
    assert create(PointsConfig(methods=("sift",), rotated_retry=True)).name == "sift"


def test_rounds_and_sizes_are_those_of_the_configuration() -> None:
    matcher = Counting(0)
    image = Image(np.zeros((900, 1300, 3), np.uint8))
    chosen = RotatedRetryConfig(turns=(0, 180), far_turns=(), sizes=(700,))
    RotatedRetry(matcher, lambda: matcher, 1600, chosen).match(image, image)
    assert matcher.retried == 2
    assert both_ways((0, 45)) == [0, 45, -45]
    assert both_ways((90, 135, 180)) == [90, -90, 135, -135, 180]


@pytest.mark.weights
@pytest.mark.parametrize("angle", [70, 180])
def test_turned_images(angle: int) -> None:
    """XFeat alone does not tolerate such turns."""
    left = Image(texture(320, 256))
    centre = cv2.getRotationMatrix2D((160, 128), angle, 0.8)
    turn = np.vstack([centre, [0, 0, 1]])
    right = Image(warped(left.rgb, turn))
    once, retried = (build(config("xfeat", rotated_retry=more)) for more in (False, True))

    def good(matches: PointMatches) -> int:
        return int((np.linalg.norm(project(turn, matches.left) - matches.right, axis=1) < 3).sum())

    found = retried.match(left, right)
    assert good(once.match(left, right)) < 20
    assert good(found) > 60
    if angle == 180:  # one of them tells whether it depends on earlier calls
        assert retried.match(left, right).left.tobytes() == found.left.tobytes()
