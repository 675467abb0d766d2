"""Whatever it holds, data prints itself on one short line."""

import dataclasses

import numpy as np
import pytest

import zpm2
from zpm2.errors import Failed
from zpm2.model import Camera, Georeference, Image, ImagePolygons, Mask, PointMatches, Polygon, PolygonMatch
from zpm2.model.brief import LONGEST
from zpm2.result import MatchResult

RING = np.random.default_rng(0).uniform(0, 900, (700, 2))
POLYGON = Polygon(4, RING, score=0.98765432)
POINTS = PointMatches(RING, RING, RING[:, 0])
SIDE = ImagePolygons(900, 800, [POLYGON] * 120, "a/" * 90 + "left.png", Image(np.zeros((800, 900, 3), np.uint8)))
MATCH = PolygonMatch(4, 4, 0.9, 0.2, 30, "global", nodes=np.zeros((90, 2), np.int64))
RESULT = MatchResult(
    SIDE, SIDE, [MATCH] * 100, POINTS, np.eye(3), Failed("too few points"), {"a": {}}, {"read": 1.0}, ["careful"] * 3
)


@pytest.mark.parametrize(
    "data",
    [
        POLYGON,
        POINTS,
        SIDE,
        MATCH,
        RESULT,
        SIDE.image,
        Camera(np.eye(3), (900, 800)),
        Mask(0, 0, np.ones((50, 90), bool)),
    ],
)
def test_one_short_line(data: object) -> None:
    assert "\n" not in repr(data)
    assert repr(data).startswith(f"{type(data).__name__}(")
    assert len(repr(data)) < 600


def test_numbers_and_names_are_shown_arrays_and_lists_are_counted() -> None:
    assert repr(POLYGON) == "Polygon(id=4, exterior 700 x 2, score=0.9877)"
    assert repr(ImagePolygons(5, 4, [POLYGON], "a.png")) == "ImagePolygons(width=5, height=4, 1 polygons, path='a.png')"
    text = repr(RESULT)
    for part in ("100 matches", "120 polygons", "left 700 x 2", "fundamental 3 x 3", "too few points", "3 warnings"):
        assert part in text
    assert repr(Georeference()) == "Georeference()"
    assert "EPSG:32633" in repr(dataclasses.replace(SIDE, geo=Georeference("EPSG:32633")))


def test_long_texts_are_cut_in_front() -> None:
    assert f"path='...{SIDE.path[-LONGEST:]}'" in repr(SIDE)


def test_every_public_result_has_the_rule() -> None:
    from zpm2.model.brief import brief

    for kind in (zpm2.MatchResult, zpm2.pose.PoseResult, zpm2.cloud.PolygonCloud, zpm2.cloud.SurfaceMesh, zpm2.Polygon):
        assert kind.__repr__ is brief
