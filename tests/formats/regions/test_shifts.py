"""Shift vectors on the ground."""

import json
from pathlib import Path

import numpy as np
import pytest
from region_samples import AFFINE, UTM, Photo

from zpm2.errors import InputError
from zpm2.formats.regions.region import GivenRegion
from zpm2.formats.regions.shifts import Shift, has_shifts, write_shifts
from zpm2.model import Georeference

pytest.importorskip("rasterio", reason="extra geo is not installed")

LEFT = Photo(geo=UTM)
RIGHT = Photo(
    geo=Georeference("EPSG:32632", AFFINE + np.array([[0, 0, 7.0], [0, 0, -3.0]]), 0.5)
)  # another cut of the ground
SHIFTS = [
    Shift(GivenRegion((), 12, "way/12", label="roof", row=2), np.array([10.0, 8]), np.array([0.0, 8]), 0.25),
    Shift(GivenRegion((), None, row=5), np.array([20.0, 8]), np.array([20.0, 12])),
]
METERS = [(2.0, -3.0), (7.0, -5.0)]


def test_a_geopackage_of_lines(tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    path = write_shifts(tmp_path / "shifts.gpkg", SHIFTS, LEFT, RIGHT)
    meta, _, wkb, columns = pyogrio.raw.read(path, layer="shifts")
    table = dict(zip(meta["fields"], (column.tolist() for column in columns), strict=True))
    assert meta["crs"] == "EPSG:32632"
    assert meta["geometry_type"] == "LineString"
    assert len(wkb) == 2
    assert list(zip(table["dx"], table["dy"], strict=True)) == METERS
    assert table["length"] == pytest.approx(np.hypot(*np.transpose(METERS)), abs=1e-4)
    assert (table["id"], table["row"], table["label"]) == (["way/12", None], [2, 5], ["roof", None])
    assert table["sigma"][0] == 0.25
    assert np.isnan(table["sigma"][1])
    first = path.read_bytes()
    assert write_shifts(path, SHIFTS, LEFT, RIGHT).read_bytes() == first


def test_geojson_is_in_degrees_and_metres_agree_with_them(tmp_path: Path) -> None:
    path = write_shifts(tmp_path / "shifts.geojson", SHIFTS, LEFT, RIGHT)
    features = json.loads(path.read_text())["features"]
    assert [(f["properties"]["dx"], f["properties"]["dy"]) for f in features] == METERS
    (lon, lat), (to_lon, to_lat) = features[0]["geometry"]["coordinates"]
    assert (lon, lat) == pytest.approx((9.0, 47.85), abs=0.01)  # the middle of zone 32
    east, north = np.radians(to_lon - lon) * 6.39e6 * np.cos(np.radians(lat)), np.radians(to_lat - lat) * 6.37e6
    assert (east, north) == pytest.approx(METERS[0], abs=0.01)


def test_degrees_as_the_reference_system(tmp_path: Path) -> None:
    """The same ground in longitude and latitude has the same shifts."""
    matrix = np.array([[1e-5, 0, 9.0], [0, -1e-5, 47.85]])
    place = Photo(geo=Georeference("EPSG:4326", matrix))
    shift = Shift(GivenRegion((), 1, "1"), np.array([0.0, 0]), np.array([100.0, 100.0]))
    found = json.loads(write_shifts(tmp_path / "a.json", [shift], place, place).read_text())["features"][0][
        "properties"
    ]
    # Snyder 1987, Map Projections, table of the lengths of a degree: 111.19 km of latitude, 74.8 km of longitude at 48
    assert (found["dx"], found["dy"]) == pytest.approx((74.84, -111.18), abs=0.1)


def test_no_georeference_no_metres(tmp_path: Path) -> None:
    assert has_shifts(LEFT, RIGHT)
    assert not has_shifts(LEFT, Photo())
    with pytest.raises(InputError, match=r"left\.png has no georeference"):
        write_shifts(tmp_path / "a.gpkg", SHIFTS, LEFT, Photo())


def test_no_shifts_are_a_file_too(tmp_path: Path) -> None:
    assert json.loads(write_shifts(tmp_path / "a.geojson", [], LEFT, RIGHT).read_text())["features"] == []
    pytest.importorskip("pyogrio")
    assert write_shifts(tmp_path / "a.gpkg", [], LEFT, RIGHT).exists()
