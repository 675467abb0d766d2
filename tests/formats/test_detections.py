"""Polygons as the arrays of supervision.Detections."""

import numpy as np
import pytest

from zpm2 import MatchResult, memory
from zpm2.errors import InputError
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch

SQUARE = np.array([[2, 1], [6, 1], [6, 4], [2, 4.0]])


@pytest.fixture
def result() -> MatchResult:
    left = ImagePolygons(8, 5, [Polygon(3, SQUARE, (), 0.9, None, "roof"), Polygon(7, SQUARE / 2)])
    right = ImagePolygons(8, 5, [Polygon(0, SQUARE)])
    match = PolygonMatch(3, 0, 0.75, 0.2, 9, "global")
    return MatchResult(left, right, [match], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})


def test_arrays(result: MatchResult) -> None:
    found = result.detections("left")
    assert found["xyxy"].tolist() == [[2, 1, 6, 4], [1, 0.5, 3, 2]]
    assert found["mask"] is not None
    assert found["mask"].shape == (2, 5, 8)
    assert found["mask"][0].sum() == 12
    assert found["mask"][0, 1:4, 2:6].all()
    assert (found["class_id"].tolist(), found["tracker_id"].tolist()) == ([1, 0], [3, -1])
    assert found["data"]["class_name"].tolist() == ["roof", "region"]
    assert found["data"]["polygon_id"].tolist() == [3, 7]
    assert result.detections("right")["tracker_id"].tolist() == [3]
    assert result.detections("right", masks=False)["mask"] is None


def test_masks_that_do_not_fit(result: MatchResult) -> None:
    with memory.within("0.00001MB"), pytest.raises(InputError, match="without masks"):
        result.detections("left")


def test_no_polygons(result: MatchResult) -> None:
    empty = ImagePolygons(8, 5, [])
    found = MatchResult(empty, empty, [], PointMatches.empty(), np.eye(3), np.eye(3), {}, {}).detections("left")
    assert (found["xyxy"].shape, found["class_id"].shape) == ((0, 4), (0,))


def test_supervision_takes_them(result: MatchResult) -> None:
    supervision = pytest.importorskip("supervision", reason="supervision is not installed")
    found = supervision.Detections(**result.detections("left"))
    assert len(found) == 2
    assert found.area.tolist() == [12, found.mask[1].sum()]
    assert found[found.tracker_id >= 0].data["class_name"].tolist() == ["roof"]
