"""Photographs too large to be seen as a whole: by windows, with the same outcome."""

from collections import Counter

import numpy as np
import pytest
import shapely

from zpm2 import api, config, geometry
from zpm2.contract.scenes import texture, warped
from zpm2.features.methods.sift import SiftDetector
from zpm2.model import Polygon

TURN = np.array([[0.0, -0.8, 760.0], [0.8, 0.0, 20.0], [0, 0, 1]])  # a quarter turn, reduced
SHIFT = np.array([[1.0, 0.02, -60.0], [-0.02, 1.0, 25.0], [0, 0, 1]])
SETTINGS = ["points.methods=sift", "points.escalate.on=false", "carry.window=256", "segment.model=classical"]
CONFIG = config.assign(config.preset("default"), SETTINGS)
SQUARES = [
    Polygon(k, np.array([(x, y), (x + 40, y), (x + 40, y + 40), (x, y + 40)], float))
    for k, (x, y) in enumerate([(80, 60), (500, 80), (300, 300), (620, 420), (10, 200)])
]


@pytest.fixture(scope="module")
def left():
    return texture(760, 560)


@pytest.mark.parametrize("matrix", [SHIFT, TURN], ids=["shift", "turn"])
def test_places_are_those_of_the_map(left, matrix):
    right = warped(left, matrix)
    result = api.Matcher(CONFIG).carry(left, right, SQUARES, rigid=True)
    box = shapely.box(0, 0, result.right.width, result.right.height)
    for square, outcome in zip(SQUARES, result.outcomes, strict=True):
        truth = shapely.transform(square.shape, lambda xy: geometry.project(matrix, xy))
        share = truth.intersection(box).area / truth.area
        if share < 0.05:
            assert outcome.shape is None
        elif share > 0.95:
            assert outcome.status == "found", (square.id, outcome.reason)
            assert outcome.shape.centroid.distance(truth.centroid) < 1
            assert outcome.shape.area == pytest.approx(truth.area, rel=0.05)


def test_another_scene_gives_no_places(left):
    result = api.Matcher(CONFIG).carry(left, texture(760, 560, seed=9), SQUARES, rigid=True)
    assert result.counts() == {"not found": len(SQUARES)}
    assert "no region was found" in result.warnings[-1]


def test_left_windows_are_looked_at_once_for_several_right_photographs(left, tmp_path, monkeypatch):
    seen, detect = Counter[bytes](), SiftDetector.detect

    def counted(self, images):
        seen.update(image.rgb.tobytes() for image in images)
        return detect(self, images)

    monkeypatch.setattr(SiftDetector, "detect", counted)
    smaller = np.diag([0.97, 0.97, 1.0]) @ SHIFT  # hardly: its windows are not reduced
    rights = [warped(left, matrix) for matrix in (SHIFT, smaller)]
    matcher = api.Matcher(CONFIG, aside=tmp_path)
    found = [matcher.carry(left, right, SQUARES[:2], rigid=True) for right in rights]
    whole = left.tobytes()  # twice, for the overview of each pair
    assert [n for image, n in seen.items() if n > 1 and image != whole] == []
    assert len(seen) == 3 + 2 * 3  # photographs; two windows, and each as both right ones show it
    for right, result in zip(rights, found, strict=True):
        alone = api.Matcher(CONFIG).carry(left, right, SQUARES[:2], rigid=True)
        for one, other in zip(result.outcomes, alone.outcomes, strict=True):
            assert (one.status, one.sigma, one.shape) == (other.status, other.sigma, other.shape)
