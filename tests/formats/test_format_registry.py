"""The registry of output formats: one list, and one file to add to it."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from zpm2.cli.options import known_formats
from zpm2.errors import ConfigError, MissingDependency
from zpm2.formats import registry
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.formats.saving import file_names
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult

SQUARE = np.array([[2, 2], [30, 2], [30, 30], [2, 30.0]])


@pytest.fixture
def result(tmp_path: Path) -> MatchResult:
    path = tmp_path / "a.png"
    PIL.Image.fromarray(np.full((40, 40, 3), 99, np.uint8)).save(path)
    side = ImagePolygons(40, 40, [Polygon(0, SQUARE)], str(path))
    match = PolygonMatch(0, 0, 0.9, 1.0, 4, "local")
    return MatchResult(side, side, [match], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})


@pytest.fixture
def toy() -> Iterator[OutputFormat]:
    """A format as somebody else would write it, outside of the package."""

    def write(result: PairResult, folder: Path) -> None:
        rows = [f"{match.left},{match.right}" for match in result.matches]
        (folder / "pairs.csv").write_text("\n".join(rows))

    yield register(OutputFormat("csv", ("pairs.csv",), write))
    registry.FORMATS.remove("csv")


def test_the_formats_of_the_package() -> None:
    assert registry.names() == ["coco", "geojson", "geoparquet", "gpkg", "cvat", "labelme", "yolo", "shapefile"]
    assert {"left.geojson", "matches.gpkg", "overlay.png", "contact.png", "matches.json"} <= set(file_names())
    assert "left.shp" not in file_names()
    assert {"left.shp", "right.dbf", "left.coco.json"} <= set(file_names(["shapefile", "coco"]))
    assert len(set(file_names(registry.names()))) == len(file_names(registry.names()))


def test_a_format_from_outside_is_one_of_them(toy: OutputFormat, result: MatchResult, tmp_path: Path) -> None:
    assert "csv" in list(known_formats())
    assert "pairs.csv" in file_names(["csv"])
    assert "pairs.csv" not in file_names()
    folder = result.save(tmp_path / "out", ["csv"])
    assert (folder / "pairs.csv").read_text() == "0,0"
    assert not (result.save(tmp_path / "plain") / "pairs.csv").exists()
    assert json.loads((folder / "matches.json").read_text())["schema"] == "zpm2-matches/1"


def test_the_command_takes_it(toy: OutputFormat, run: Any, tmp_path: Path) -> None:
    code, _, err = run("match", "no.png", "no.png", "-o", tmp_path / "out", "--format", "csv", "--format", "kml")
    assert (code, err) == (
        2,
        "zpm2: unknown format 'kml'; formats are: coco, geojson, geoparquet, gpkg, cvat, labelme, yolo, shapefile, "
        "csv\n",
    )


def test_a_missing_package_is_named_before_anything_is_written(
    result: MatchResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyogrio.raw", None)
    with pytest.raises(MissingDependency, match="pyogrio"):
        result.save(tmp_path / "out", ["gpkg"])
    with pytest.raises(ConfigError, match="unknown format 'svg'"):
        result.save(tmp_path / "out", ["svg"])
    assert not (tmp_path / "out").exists()
