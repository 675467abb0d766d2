"""The report page of carried regions."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely

from zpm2.carry.outcome import Outcome
from zpm2.carry.result import CarryResult, Side
from zpm2.formats.regions.region import GivenRegion

SQUARE = shapely.box(10, 10, 40, 40)
TWO = shapely.MultiPolygon([shapely.box(60, 10, 90, 40), shapely.box(95, 10, 100, 15)])


def carried(folder: Path, ids: tuple[int | None, ...]) -> CarryResult:
    for name in ("left", "right"):
        pixels = np.random.default_rng(0).integers(0, 255, (80, 120, 3), np.uint8)
        PIL.Image.fromarray(pixels).save(folder / f"{name}.png")
    sides = [Side(str(folder / f"{name}.png"), 120, 80) for name in ("left", "right")]
    outcomes = [
        Outcome("found", "points and outline agree", shapely.box(5, 10, 35, 40), 0.9, None, 0.8, 0.5, 7, (20, 25)),
        Outcome("hidden", "nothing <there>", None, 0.0, 0.0),
        Outcome("in part", "half of it", TWO, 0.7, 0.5, 0.6, 0.5, 3, (75, 25)),
        Outcome("not found", "it has no area", None, 0.0, None),
    ]
    regions = [GivenRegion((), number, str(number), label=label) for number, label in zip(ids, "abcd", strict=True)]
    shapes = [SQUARE, shapely.box(45, 50, 70, 70), TWO, None]
    return CarryResult(sides[0], sides[1], regions, shapes, outcomes, {}, {"read": 1.0})


def data_of(folder: Path) -> Any:
    page = (folder / "report.html").read_text(encoding="utf-8")
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])


def test_the_page_shows_every_region_and_what_became_of_it(tmp_path: Path) -> None:
    result = carried(tmp_path, (4, 7, 9, 12))
    folder = result.save(tmp_path / "out", report=True)
    data = data_of(folder)
    left = data["sides"][0]["polygons"]
    assert [(polygon["id"], polygon["label"]) for polygon in left] == [(4, "a"), (7, "b"), (9, "c")]
    assert [polygon["why"] for polygon in left] == [None, "hidden", None]
    assert left[1]["remark"] == "nothing <there>"
    first, second = data["matches"]
    assert (first["id"], first["stage"], first["cost"], first["visible"], first["dsf"]) == (4, "found", None, None, 7)
    assert (second["stage"], second["visible"]) == ("in part", 0.5)
    assert data["sides"][1]["polygons"][1]["area"] == 900  # the largest part
    assert data["reasons"]["hidden"] == data["reasons"]["occluded"]
    assert data["document"] == "carry.json"
    result.save(folder)
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize("ids", [(4, 4, 9, 12), (4, None, 9, 12)])
def test_regions_without_numbers_of_their_own_have_their_row(ids: tuple[int | None, ...], tmp_path: Path) -> None:
    data = data_of(carried(tmp_path, ids).save(tmp_path / "out", report=True))
    assert [polygon["id"] for polygon in data["sides"][0]["polygons"]] == [0, 1, 2]


def test_no_region_at_all(tmp_path: Path) -> None:
    result = carried(tmp_path, (1, 2, 3, 4))
    empty = CarryResult(result.left, result.right, [], [], [])
    assert data_of(empty.save(tmp_path / "out", report=True))["matches"] == []
