"""STAC Items of results, read back and validated by pystac where it is there."""

import json
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered import Run

from zpm2 import MatchResult
from zpm2.errors import ConfigError, InputError
from zpm2.export import stac
from zpm2.formats import registry
from zpm2.formats.regions import yolo
from zpm2.model import Georeference, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.photos.geolocation import WGS84, between

pytest.importorskip("rasterio", reason="extra geo is not installed")
SIZE = (300, 200)
UTM = np.array([[0.5, 0, 500_000], [0, -0.5, 5_000_000.0]])
BEYOND = ("0001-01-01T00:00:00+05:00", "2024-01-01/9999-12-31T23:00:00-05:00")  # the calendar, in UTC
NOON = datetime(2024, 5, 31, 12, tzinfo=UTC)


def saved(folder: Path, crs: str | None = "EPSG:32633", shift: float = 50.0, times: tuple[str, str] = ("", "")) -> Path:
    """A result of two GeoTIFF-like photographs, the right one `shift` m to the east."""
    folder.mkdir(parents=True, exist_ok=True)
    sides = []
    for name, east, time in zip(("left", "right"), (0.0, shift), times, strict=True):
        path, exif = folder / f"{name}.tif", PIL.Image.Exif()
        if time:
            exif[stac.TIFF_TIME] = time
        PIL.Image.new("RGB", SIZE, (90, 120, 40)).save(path, exif=exif)
        matrix = np.array(UTM)
        matrix[0, 2] += east
        square = np.array([[100, 100], [150, 100], [150, 150], [100, 150.0]])
        geo = Georeference(crs, None if crs is None else matrix, None if crs is None else 0.5)
        sides.append(ImagePolygons(*SIZE, [Polygon(0, square)], str(path), geo=geo))
    match = PolygonMatch(0, 0, 0.9, 0.1, 1, "global")
    result = MatchResult(sides[0], sides[1], [match], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})
    return result.save(folder / "result", pictures=False)


def made(out: Path) -> dict[str, Any]:
    (file,) = out.glob("*.json")
    document: dict[str, Any] = json.loads(file.read_text())
    if all(find_spec(name) for name in ("pystac", "jsonschema", "referencing")):
        import pystac
        from pystac.extensions.projection import ProjectionExtension
        from pystac.validation.stac_validator import JsonSchemaSTACValidator

        item = pystac.Item.from_file(str(file))
        # with the schema that comes with it; that of the extension is on a network
        JsonSchemaSTACValidator().validate_core(document, pystac.STACObjectType.ITEM, stac.VERSION)
        assert ProjectionExtension.ext(item.get_assets()["left"]).shape == [SIZE[1], SIZE[0]]
        assert item.get_assets()["matches.json"].media_type == pystac.MediaType.JSON
        assert Path(item.get_assets()["left"].get_absolute_href() or "").is_file()
    return document


def test_the_files_of_every_format_are_known() -> None:
    """But those that only stand beside another one: of a GeoPackage or a shapefile, and the names of YOLO's classes."""
    names = ("coco", "geojson", "geoparquet", "gpkg", "cvat", "labelme", "yolo", "shapefile")
    files = {file for each in registry.known() if each.name in names for file in each.files}
    kinds = (".json", ".geojson", ".parquet", ".gpkg", ".xml", ".txt", ".shp")
    main = {file for file in files if Path(file).suffix in kinds}
    assert len(main) == 17
    assert main - {yolo.NAMES} <= set(stac.FILES)


def test_where_when_and_which_files(tmp_path: Path, run: Run) -> None:
    result = saved(tmp_path, times=("2019:05:31 12:00:00", "2024:05:31 12:00:00"))
    code, out, err = run("export", result, "--to", "stac", "-o", tmp_path / "catalogue")
    assert code == 0, err
    assert "result.json" in out
    item = made(tmp_path / "catalogue")
    west, south, east, north = item["bbox"]
    assert (west, north) == pytest.approx((15.0, 45.1535), abs=1e-3)  # 500 km east in zone 33 is 15 degrees
    assert (east - west) * 78_700 == pytest.approx(200, rel=0.02)  # m: 150, and 50 more of the right one
    assert (north - south) * 111_130 == pytest.approx(100, rel=0.02)
    footprint = shapely.geometry.shape(item["geometry"])
    assert footprint.geom_type == "Polygon"
    assert footprint.is_valid
    assert footprint.exterior.is_ccw
    assert footprint.bounds == pytest.approx(tuple(item["bbox"]), abs=1e-6)
    properties = item["properties"]
    assert properties["datetime"] is None
    assert properties["start_datetime"] == "2019-05-31T12:00:00Z"
    assert properties["end_datetime"] == "2024-05-31T12:00:00Z"
    assert properties["proj:code"] == "EPSG:32633"
    left = item["assets"]["left"]
    assert left["type"] == "image/tiff; application=geotiff"
    assert left["proj:shape"] == [200, 300]
    assert left["proj:transform"] == [0.5, 0, 500_000, 0, -0.5, 5_000_000]
    for asset in item["assets"].values():
        assert (tmp_path / "catalogue" / asset["href"]).is_file()
    assert {"matches.json", "left.geojson", "right.geojson"} <= set(item["assets"])
    again = (tmp_path / "catalogue" / "result.json").read_bytes()
    assert run("export", result, "--to", "stac", "-o", tmp_path / "catalogue").code == 0
    assert (tmp_path / "catalogue" / "result.json").read_bytes() == again


def test_a_time_is_asked_for(tmp_path: Path, run: Run) -> None:
    result, out = saved(tmp_path, times=("2019:05:31 12:00:00", "")), tmp_path / "catalogue"
    code, _, err = run("export", result, "--to", "stac", "-o", out)
    assert (code, "right.tif does not say when it was taken: give --datetime" in err) == (2, True)
    assert not out.exists()
    code, _, err = run("export", result, "--to", "stac", "-o", out, "--datetime", "2024-05-31T14:00:00+02:00")
    assert code == 0, err
    assert made(out)["properties"]["datetime"] == "2024-05-31T12:00:00Z"
    code, _, err = run("export", result, "--datetime", "2024-05-31", "-o", out)
    assert (code, "--to stac" in err) == (2, True)


def test_a_result_without_a_place_is_refused(tmp_path: Path) -> None:
    folder = saved(tmp_path, None)
    with pytest.raises(InputError, match="not georeferenced"):
        stac.item("a", folder, MatchResult.load(folder), tmp_path, (NOON, NOON))


def test_across_the_antimeridian(tmp_path: Path) -> None:
    for k, start in enumerate((179.99, -180.01)):
        matrix = np.array([[1e-4, 0, start], [0, -1e-4, 10.0]])
        side = ImagePolygons(300, 200, [], "a.tif", geo=Georeference("EPSG:4326", matrix))
        ground = stac.footprint([side, side])
        assert stac.bounds(ground) == pytest.approx([179.99, 9.98, -179.98, 10.0]), k
        whole = stac.cut(ground)
        assert whole.geom_type == "MultiPolygon"
        assert sorted(part.bounds[0] for part in whole.geoms) == pytest.approx([-180, 179.99])
        assert whole.area == pytest.approx(0.03 * 0.02)


@pytest.mark.parametrize(
    ("crs", "matrix", "size", "box"),
    [
        ("EPSG:4326", [[1, 0, -100], [0, -1, 50]], (200, 100), (-100, -50, 100, 50)),
        ("EPSG:4326", [[1, 0, 100], [0, -1, 50]], (200, 100), (100, -50, -60, 50)),
        ("EPSG:4326", [[1, 0, -180], [0, -1, 90]], (360, 180), (-180, -90, 180, 90)),
        ("EPSG:4326", [[1, 0, 0], [0, -1, 90]], (360, 180), (-180, -90, 180, 90)),
        ("EPSG:3413", [[1000, 0, -100_000], [0, -1000, 50_000]], (300, 225), (-180, 87.547, 180, 90)),
        ("EPSG:3031", [[10_000, 0, -3e6], [0, -10_000, 3e6]], (600, 600), (-180, -90, 180, -52.317)),
        ("EPSG:3031", [[-10_000, 0, 3e6], [0, -10_000, 3e6]], (600, 600), (-180, -90, 180, -52.317)),
    ],
)
def test_wide_photographs_and_poles(crs: str, matrix: Any, size: tuple[int, int], box: tuple[float, ...]) -> None:
    side = ImagePolygons(*size, [], "a.tif", geo=Georeference(crs, np.array(matrix, np.float64)))
    ground = stac.footprint([side, side])
    assert stac.bounds(ground) == pytest.approx(box, abs=1e-3)
    pixels = side.geo.to_world(np.random.default_rng(0).random((500, 2)) * size)
    degrees = between(crs, WGS84, pixels)
    degrees[:, 0] = (degrees[:, 0] + 180) % 360 - 180
    assert shapely.contains_xy(stac.cut(ground), degrees).all()


def test_a_pole_and_what_lies_beside_it() -> None:
    matrices = [[[1000, 0, -100_000], [0, -1000, 50_000]], [[1000, 0, -250_000], [0, -1000, 50_000.0]]]
    pole, beside = (ImagePolygons(300, 225, [], "a.tif", geo=Georeference("EPSG:3413", np.array(m))) for m in matrices)
    both, other = (stac.cut(stac.footprint(sides)) for sides in ((pole, beside), (beside, pole)))
    assert both.is_valid
    parts = [stac.cut(stac.footprint([side])) for side in (pole, beside)]
    assert both.symmetric_difference(other).area < 1e-3
    assert both.symmetric_difference(parts[0].union(parts[1])).area < 1e-3
    assert parts[0].intersects(parts[1])


@pytest.mark.parametrize(("size", "north"), [(1e-9, 5.0), (1.0, 100.0)])
def test_a_photograph_without_area(size: float, north: float) -> None:
    side = ImagePolygons(9, 9, [], "a.tif", geo=Georeference("EPSG:4326", np.array([[size, 0, 5], [0, -size, north]])))
    with pytest.raises(InputError, match=r"a\.tif encloses no area"):
        stac.footprint([side])


@settings(max_examples=50)
@given(st.floats(-180, 180), st.floats(-80, 79), st.floats(1e-6, 0.01), st.floats(1e-6, 0.01))
def test_footprints_keep_their_area(west: float, south: float, wide: float, high: float) -> None:
    matrix = np.array([[wide, 0, west], [0, -high, south + 100 * high]])
    side = ImagePolygons(100, 100, [], "a.tif", geo=Georeference("EPSG:4326", matrix))
    whole = stac.cut(stac.footprint([side, side]))
    x0, _, x1, _ = whole.bounds
    assert -180 <= x0 <= x1 <= 180
    assert whole.area == pytest.approx(100 * wide * 100 * high, rel=0.01, abs=1e-8)


@pytest.mark.parametrize(
    ("text", "first", "last"),
    [
        ("2024-05-31", "2024-05-31T00:00:00Z", "2024-05-31T00:00:00Z"),
        ("2019-01-01T00:00:00Z/2024-05-31T10:00+02:00", "2019-01-01T00:00:00Z", "2024-05-31T08:00:00Z"),
    ],
)
def test_times_of_the_user(text: str, first: str, last: str) -> None:
    assert tuple(moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ") for moment in stac.read_times(text)) == (
        first,
        last,
    )


@pytest.mark.parametrize(
    "text", ["", "yesterday", "2024-05-31/2019-05-31", "2024-01-01/2024-01-02/2024-01-03", *BEYOND]
)
def test_times_that_are_none(text: str) -> None:
    with pytest.raises(ConfigError, match="START/END"):
        stac.read_times(text)


def test_the_time_of_a_camera(tmp_path: Path) -> None:
    exif = PIL.Image.Exif()
    exif[stac.TIFF_TIME] = "2020:01:01 00:00:00"  # when it was edited
    exif.get_ifd(stac.pictures.EXIF_IFD).update({stac.ORIGINAL: "2019:05:31 12:00:00", stac.OFFSET: "+02:00"})
    PIL.Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg", exif=exif)
    assert stac.taken(tmp_path / "a.jpg") == datetime(2019, 5, 31, 10, tzinfo=UTC)
    exif.get_ifd(stac.pictures.EXIF_IFD)[stac.ORIGINAL] = "0000:00:00 00:00:00"
    PIL.Image.new("RGB", (8, 8)).save(tmp_path / "b.jpg", exif=exif)
    assert stac.taken(tmp_path / "b.jpg") is None
    exif.get_ifd(stac.pictures.EXIF_IFD).update({stac.ORIGINAL: "0001:01:01 00:00:00", stac.OFFSET: "+05:00"})
    PIL.Image.new("RGB", (8, 8)).save(tmp_path / "c.jpg", exif=exif)
    assert stac.taken(tmp_path / "c.jpg") is None
    assert stac.taken(tmp_path / "missing.jpg") is None
