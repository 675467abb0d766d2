"""GeoParquet, read back by pyarrow as geopandas, DuckDB and GDAL do."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from zpm2 import MatchResult
from zpm2.errors import MissingDependency
from zpm2.formats.geoparquet import write_layer
from zpm2.formats.layer import Layer, world_shapes
from zpm2.model import Counterpart, Georeference, ImagePolygons, PointMatches, Polygon, PolygonMatch

parquet = pytest.importorskip("pyarrow.parquet")

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])
HOLE = np.array([[2, 2], [4, 2], [4, 4.0]])
POLYGONS = [
    Polygon(3, SQUARE, (HOLE,), 0.9, None, "Dach, grün", "a-7", {"floors": 2, "flat": True}),
    Polygon(8, SQUARE / 2 + 1, (), 0.5, 3, None, None, {"floors": None, "height": 2.5}),
]
UTM = Georeference("EPSG:32632", np.array([[0.1, 0, 500_000.0], [0, -0.1, 5_300_000.0]]), 0.1)


def layer(geo: Georeference, polygons: list[Polygon] = POLYGONS) -> Layer:
    return Layer("left", polygons, geo, {3: Counterpart(3, 11, 0.75)}, {8: "beyond the other photograph"})


def test_columns_have_types_and_nulls(tmp_path: Path) -> None:
    table = parquet.read_table(write_layer(tmp_path / "a.parquet", layer(Georeference())))
    rows = table.drop_columns(["geometry"]).to_pylist()
    assert rows[0] == {
        "polygon_id": 3,
        "area_px": 98.0,
        "area_m2": None,
        "score": 0.9,
        "parent": None,
        "label": "Dach, grün",
        "match": 11,
        "match_id": 3,
        "confidence": 0.75,
        "unmatched": None,
        "source_id": "a-7",
        "floors": 2,
        "flat": True,
        "height": None,
    }
    assert [rows[1][name] for name in ("parent", "match", "confidence", "unmatched", "floors", "flat", "height")] == [
        *(3, None, None, "beyond the other photograph", None, None, 2.5)
    ]


@pytest.mark.parametrize("geo", [UTM, Georeference()], ids=["placed", "in pixels"])
def test_geometries_and_metadata(tmp_path: Path, geo: Georeference) -> None:
    if geo.crs:
        pytest.importorskip("rasterio")
    table = parquet.read_table(write_layer(tmp_path / "a.parquet", layer(geo)))
    shapes = shapely.from_wkb(table["geometry"].to_pylist())
    assert shapely.equals_exact(shapes, world_shapes(layer(geo))).all()
    about = json.loads(table.schema.metadata[b"geo"])
    column = about["columns"][about["primary_column"]]
    assert column["bbox"] == shapely.total_bounds(shapes).tolist()
    assert (about["version"], column["encoding"], column["geometry_types"]) == ("1.1.0", "WKB", ["Polygon"])
    assert all(shape.exterior.is_ccw for shape in shapes)
    if geo.crs:
        assert column["crs"]["id"] == {"authority": "EPSG", "code": 32632}
    else:
        assert column["crs"] is None  # not missing: that would mean longitude and latitude


def test_no_polygons(tmp_path: Path) -> None:
    table = parquet.read_table(write_layer(tmp_path / "a.parquet", layer(Georeference(), [])))
    assert table.num_rows == 0
    assert "bbox" not in json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]


def test_a_result_writes_both_layers_and_the_matches(tmp_path: Path) -> None:
    left = ImagePolygons(20, 20, POLYGONS)
    right = dataclasses.replace(left, polygons=[Polygon(11, SQUARE)])
    match = PolygonMatch(3, 11, 0.75, 0.2, 9, "global", 0.8)
    result = MatchResult(left, right, [match], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})
    from zpm2.formats.writers import geoparquet

    geoparquet.write(result, tmp_path)
    assert parquet.read_table(tmp_path / "left.parquet")["match"].to_pylist() == [11, None]
    assert parquet.read_table(tmp_path / "right.parquet")["match"].to_pylist() == [3]
    expected = {"match_id": 3, "left": 3, "right": 11, "confidence": 0.75, "cost": 0.2, "dsf": 9, "stage": "global"}
    assert parquet.read_table(tmp_path / "matches.parquet").to_pylist() == [expected | {"overlap": 0.8}]


def test_geopandas_reads_it(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    pytest.importorskip("rasterio")
    frame = geopandas.read_parquet(write_layer(tmp_path / "a.parquet", layer(UTM)))
    assert frame.crs.to_epsg() == 32632
    assert frame.area.tolist() == pytest.approx([0.98, 0.25])


def test_without_pyarrow(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(MissingDependency, match=r"zpm2\[parquet\]"):
        write_layer(tmp_path / "a.parquet", layer(Georeference()))
    assert not list(tmp_path.iterdir())
