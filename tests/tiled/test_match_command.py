"""`zpm2 match` on georeferenced photographs and in tiles: what a person who opens the results in a GIS gets."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely
from rendered import Pair, Run

from zpm2 import MatchResult

rasterio = pytest.importorskip("rasterio", reason="extra geo is not installed")
pyogrio = pytest.importorskip("pyogrio", reason="extra geo is not installed")

from rasterio.rpc import RPC  # noqa: E402

GSD = 0.5  # m per px
UTM = rasterio.Affine(GSD, 0, 500_000, 0, -GSD, 5_000_000)
TURNED = rasterio.Affine(0, GSD, 500_000, GSD, 0, 5_000_000)  # turned and mirrored: x goes north, y east


def geotiff(path: Path, picture: Path, crs: str | None, transform: Any, rpcs: Any = None) -> Path:
    pixels = np.asarray(PIL.Image.open(picture))
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 3, "width": pixels.shape[1], "height": pixels.shape[0]}
    with rasterio.open(path, "w", crs=crs, transform=transform, **profile) as file:
        file.write(pixels.transpose(2, 0, 1))
        if rpcs is not None:
            file.rpcs = rpcs
    return path


def rational(width: int, height: int) -> RPC:
    """RPCs that are an affine map: half a metre a px at the equator, 30 degrees east, 200 m high, north up."""
    unit, east, north = [1.0] + [0.0] * 19, [0.0, 1.0] + [0.0] * 18, [0.0, 0.0, -1.0] + [0.0] * 17
    return RPC(
        height_off=200.0,
        height_scale=500.0,
        lat_off=0.0,
        lat_scale=GSD * height / 2 / 110_574.3,
        long_off=30.0,
        long_scale=GSD * width / 2 / 111_319.5,
        line_off=height / 2 - 0.5,
        line_scale=height / 2,
        samp_off=width / 2 - 0.5,
        samp_scale=width / 2,
        line_num_coeff=north,
        line_den_coeff=unit,
        samp_num_coeff=east,
        samp_den_coeff=unit,
    )


@pytest.fixture(scope="module")
def epochs(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The rendered pair as GeoTIFFs of two reference systems."""
    folder = tmp_path_factory.mktemp("epochs")
    return (
        geotiff(folder / "left.tif", pair.left, "EPSG:32633", UTM),
        geotiff(folder / "right.tif", pair.right, "EPSG:32632", TURNED),
    )


def test_georeferenced_photographs_give_gis_files(
    run: Run, pair: Pair, epochs: tuple[Path, Path], tmp_path: Path
) -> None:
    code, out, err = run("match", *epochs, "-o", tmp_path, *pair.regions)
    assert code == 0, err
    assert "without a partner" in out
    result = MatchResult.load(tmp_path)
    assert len(result.matches) > 10
    assert (result.left.geo.crs, result.right.geo.crs) == ("EPSG:32633", "EPSG:32632")
    ids = {}
    for side, crs in (("left", "EPSG:32633"), ("right", "EPSG:32632")):
        info = pyogrio.read_info(tmp_path / "matches.gpkg", layer=side)
        meta, _, shapes, values = pyogrio.raw.read(tmp_path / "matches.gpkg", layer=side)
        assert info["crs"] == crs
        columns = dict(zip(meta["fields"], values, strict=True))
        polygons = {polygon.id: polygon for polygon in getattr(result, side).polygons}
        wanted = np.array([polygons[id].area for id in columns["polygon_id"]])
        np.testing.assert_allclose(columns["area_px"], wanted)
        np.testing.assert_allclose(columns["area_m2"], wanted * GSD**2, rtol=2e-3)  # the grid's scale is not 1
        assert len(shapes) == len(polygons)
        partner = columns["match"]
        assert all((columns["unmatched"][k] is None) == np.isfinite(partner[k]) for k in range(len(shapes)))
        ids[side] = set(columns["polygon_id"].tolist())
    meta, _, _, values = pyogrio.raw.read(tmp_path / "matches.gpkg", layer="matches")
    links = dict(zip(meta["fields"], values, strict=True))
    assert [(m.left, m.right) for m in result.matches] == list(zip(links["left"], links["right"], strict=True))
    assert set(links["left"]) <= ids["left"]
    degrees = json.loads((tmp_path / "left.geojson").read_text())
    lon, lat = degrees["features"][0]["geometry"]["coordinates"][0][0]
    assert (round(lon, 1), round(lat, 1)) == (15.0, 45.2)
    assert "coordinate_frame" not in degrees


@pytest.mark.parametrize("tiles", ["off", "on"])
def test_photographs_placed_by_rpc_give_gis_files(run: Run, pair: Pair, tmp_path: Path, tiles: str) -> None:
    width, height = PIL.Image.open(pair.left).size
    epochs = [
        geotiff(tmp_path / f"{side}.tif", getattr(pair, side), None, None, rational(width, height))
        for side in ("left", "right")
    ]
    code, _, err = run("match", *epochs, "-o", tmp_path / "out", "--tiles", tiles, *pair.regions)
    assert code == 0, err
    result = MatchResult.load(tmp_path / "out")
    assert any("at the mean height of its RPC, 200 m" in text for text in result.notes)
    degrees = json.loads((tmp_path / "out" / "left.geojson").read_text())["features"]
    for side in ("left", "right"):
        meta, _, shapes, values = pyogrio.raw.read(tmp_path / "out" / "matches.gpkg", layer=side)
        assert meta["crs"] == "EPSG:4326"
        ids = dict(zip(meta["fields"], values, strict=True))["polygon_id"].tolist()
        polygons = {polygon.id: polygon for polygon in getattr(result, side).polygons}
        for id, shape in zip(ids, shapely.from_wkb(shapes), strict=True):
            x0, y0, x1, y1 = polygons[id].bounds
            unit = GSD / 111_319.5, GSD / 110_574.3
            low = 30 + (x0 - width / 2) * unit[0], (height / 2 - y1) * unit[1]
            high = 30 + (x1 - width / 2) * unit[0], (height / 2 - y0) * unit[1]
            assert shape.bounds == pytest.approx((*low, *high), abs=1e-8)
            if side == "left":
                written = next(f for f in degrees if f["id"] == id)
                assert shapely.from_geojson(json.dumps(written["geometry"])).bounds == pytest.approx(
                    shape.bounds, abs=2e-8
                )


def test_results_do_not_depend_on_the_georeference(
    run: Run, pair: Pair, epochs: tuple[Path, Path], tmp_path: Path
) -> None:
    assert run("match", *epochs, "-o", tmp_path / "geo", *pair.regions).code == 0
    assert run("match", pair.left, pair.right, "-o", tmp_path / "plain", *pair.regions).code == 0
    geo, plain = (json.loads((tmp_path / name / "matches.json").read_text()) for name in ("geo", "plain"))
    assert geo["matches"] == plain["matches"]
    assert [p["vertices"] for p in geo["left"]["polygons"]] == [p["vertices"] for p in plain["left"]["polygons"]]
    assert not (tmp_path / "plain" / "matches.gpkg").exists()


@pytest.mark.parametrize("tiles", ["off", "on"])
def test_a_geotransform_without_reference_system_is_said(run: Run, pair: Pair, tmp_path: Path, tiles: str) -> None:
    left, right = (geotiff(tmp_path / f"{side}.tif", getattr(pair, side), None, UTM) for side in ("left", "right"))
    code, _, err = run("match", left, right, "-o", tmp_path / "out", "--tiles", tiles, *pair.regions)
    assert code == 0
    assert "left image: its geotransform has no reference system, results are in image px" in err
    assert json.loads((tmp_path / "out" / "left.geojson").read_text())["crs"] is None


def test_small_polygons_on_the_ground_are_left_out(
    run: Run, pair: Pair, epochs: tuple[Path, Path], tmp_path: Path
) -> None:
    assert run("match", *epochs, "-o", tmp_path / "all", *pair.regions).code == 0
    assert run("match", *epochs, "-o", tmp_path / "some", *pair.regions, "--min-area-m2", 400).code == 0
    everything, some = (MatchResult.load(tmp_path / name) for name in ("all", "some"))
    large = [p.id for p in everything.left.polygons if p.area * GSD**2 >= 400 * 1.001]
    assert 0 < len(some.left.polygons) < len(everything.left.polygons)
    assert set(large) <= {p.id for p in some.left.polygons}
    assert all(p.area * GSD**2 >= 400 * 0.998 for p in some.left.polygons)
    assert {m.left for m in some.matches} <= {p.id for p in some.left.polygons}


def test_ground_area_needs_a_pixel_size(run: Run, pair: Pair, tmp_path: Path) -> None:
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path / "x", *pair.regions, "--min-area-m2", 5)
    assert (code, err.count("\n")) == (2, 1)
    assert "--gsd" in err
    assert not (tmp_path / "x").exists()
    assert (
        run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--min-area-m2", 5, "--gsd", "0.5,0.25").code
        == 0
    )
    assert MatchResult.load(tmp_path).right.geo.gsd == 0.25


def test_formats_on_demand(run: Run, pair: Pair, tmp_path: Path) -> None:
    formats = [word for name in ("gpkg", "shapefile", "coco") for word in ("--format", name)]
    assert run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, *formats).code == 0
    result = MatchResult.load(tmp_path)
    assert pyogrio.read_info(tmp_path / "matches.gpkg", layer="left")["features"] == len(result.left.polygons)
    assert pyogrio.read_info(tmp_path / "right.shp")["features"] == len(result.right.polygons)
    annotations = json.loads((tmp_path / "left.coco.json").read_text())["annotations"]
    assert [a["polygon_id"] for a in annotations] == [p.id for p in result.left.polygons]
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path / "x", *pair.regions, "--format", "kml")
    known = "coco, geojson, geoparquet, gpkg, cvat, labelme, yolo, shapefile"
    assert (code, err) == (2, f"zpm2: unknown format 'kml'; formats are: {known}\n")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--bands", "1,2"], "raster.bands are one or three band numbers"),
        (["--bands", "7"], "band"),
        (["--gsd", "0"], "raster.gsd"),
        (["--tiles", "maybe"], "tiles.mode must be one of"),
    ],
)
def test_options_that_cannot_be(
    run: Run, pair: Pair, epochs: tuple[Path, Path], tmp_path: Path, words: list[str], says: str
) -> None:
    code, _, err = run("match", *epochs, "-o", tmp_path / "x", *pair.regions, *words)
    assert (code, err.count("\n")) == (2, 1)
    assert says in err
    assert not (tmp_path / "x").exists()


def test_tiles_find_what_the_whole_does_and_leave_no_tiles_behind(run: Run, pair: Pair, tmp_path: Path) -> None:
    small = ["--tiles", "on", "--set", "tiles.size=256"]
    assert run("match", pair.left, pair.right, "-o", tmp_path / "tiles", *pair.regions, *small).code == 0
    assert run("match", pair.left, pair.right, "-o", tmp_path / "whole", *pair.regions).code == 0
    tiles, whole = (MatchResult.load(tmp_path / name) for name in ("tiles", "whole"))
    a, b = ({(m.left, m.right) for m in result.matches} for result in (tiles, whole))
    assert len(a & b) >= 0.9 * max(len(a), len(b)) > 10
    assert not (tmp_path / "tiles" / "tiles").exists()
    assert {"stitch", "match", "explain"} <= set(tiles.timings)
