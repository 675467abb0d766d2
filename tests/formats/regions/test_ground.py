"""Regions on the ground: reference systems, layers, and what has none."""

import contextlib
import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import shapely
from region_samples import HEIGHT, SAMPLES, UTM, WIDTH, Photo, box, collection, layer, moved, to_degrees

from zpm2.errors import InputError
from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import CarriedRegion
from zpm2.formats.regions.registry import open_regions, write_regions
from zpm2.model import Georeference, Image
from zpm2.photos.geolocation import between
from zpm2.segment.given.precomputed import PrecomputedSegmenter

pytest.importorskip("rasterio", reason="extra geo is not installed")
pyogrio = pytest.importorskip("pyogrio", reason="extra geo is not installed")
pytestmark = pytest.mark.filterwarnings("ignore:'crs' was not provided")

PLACED, UNPLACED = Photo(geo=UTM), Photo()
BY_NAME = {sample.name: sample for sample in SAMPLES}


def made(name: str, folder: Path) -> Path:
    BY_NAME[name].make(folder / BY_NAME[name].file)
    return folder / BY_NAME[name].file


def write(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data))
    return path


def refused(path: Path | str, message: str, photo: Photo = PLACED) -> None:
    with pytest.raises(InputError, match=message) as caught:
        open_regions(path).read(photo)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [s.name for s in SAMPLES if s.photo.geo.located and s.name != "GeoJSON in degrees"])
def test_a_file_on_the_ground_needs_a_photograph_on_the_ground(tmp_path: Path, name: str) -> None:
    path = made(name, tmp_path)
    refused(path, rf"{path.name} is in the reference system .*left\.png has no georeference", UNPLACED)


def test_a_segmenter_takes_them(tmp_path: Path) -> None:
    image = Image(np.zeros((HEIGHT, WIDTH, 3), np.uint8), "left.png", geo=UTM)
    segmenter = PrecomputedSegmenter(made("GeoPackage in another zone", tmp_path), min_area=4)
    found = segmenter.polygons(image)
    assert [polygon.id for polygon in found] == [7, 12, 13]
    assert [polygon.source_id for polygon in found] == ["7", "12", "12"]
    assert found[0].bounds == pytest.approx((2.5, 2, 20, 20.25), abs=1e-5)
    assert len(found[0].holes) == 1
    assert found[0].properties["owner"] == "Straße"


def test_degrees_without_a_reference_system(tmp_path: Path) -> None:
    """RFC 7946, where they lie in the photograph; else pixels, as ever."""
    path = made("GeoJSON in degrees", tmp_path)
    found = open_regions(path).read(PLACED)
    assert found.notes[0] == "a.geojson is read as longitude and latitude (RFC 7946): so it lies in the image"
    assert shape_of(found.regions[0]).bounds == pytest.approx((2.5, 2, 20, 20.25), abs=0.01)
    px = write(tmp_path / "px.geojson", collection())
    assert shape_of(open_regions(px).read(PLACED).regions[0]).bounds == (2.5, 2, 20, 20.25)
    stated = write(tmp_path / "stated.geojson", moved(collection(crs=None), to_degrees))
    assert shape_of(open_regions(stated).read(PLACED).regions[0]).area < 1e-6  # it says that these are pixels


@pytest.mark.parametrize(
    "crs",
    [
        "EPSG:32632",
        {"type": "EPSG", "properties": {"code": 32632}},
        {"type": "name", "properties": {"name": "http://www.opengis.net/def/crs/EPSG/0/32632"}},
        {"type": "name", "properties": {"name": "urn:x-ogc:def:crs:EPSG:6.9:32632"}},
    ],
)
def test_names_of_reference_systems(tmp_path: Path, crs: object) -> None:
    path = write(tmp_path / "a.geojson", moved(collection(crs=crs), UTM.to_world))
    assert shape_of(open_regions(path).read(PLACED).regions[0]).bounds == pytest.approx((2.5, 2, 20, 20.25))


def test_longitude_comes_first_whatever_the_name(tmp_path: Path) -> None:
    for k, name in enumerate(("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326", "EPSG:4326")):
        crs = {"type": "name", "properties": {"name": name}}
        path = write(tmp_path / f"{k}.geojson", moved(collection(crs=crs), to_degrees))
        assert shape_of(open_regions(path).read(PLACED).regions[0]).bounds == pytest.approx(
            (2.5, 2, 20, 20.25), abs=0.01
        )


@pytest.mark.parametrize(("west", "turn"), [(179.9995, -360), (190, -360), (-170, 360)])
def test_longitudes_may_be_whole_turns_away(tmp_path: Path, west: float, turn: float) -> None:
    photo = Photo(geo=Georeference("EPSG:4326", np.array([[1e-5, 0, west], [0, -1e-5, 10]])))
    turns = np.array([turn, 0])
    for k, crs in enumerate((None, "EPSG:4326")):
        data = collection(crs=crs) if crs else collection()
        path = write(tmp_path / f"{k}.geojson", moved(data, lambda px: photo.geo.to_world(px) + turns))
        assert shape_of(open_regions(path).read(photo).regions[0]).bounds == pytest.approx((2.5, 2, 20, 20.25))


@pytest.mark.parametrize(
    ("first", "west", "east", "left", "right"),
    [(-180, 176, 184, 712, 728), (-180, -184, -176, -8, 8), (0, -4, 4, -8, 8), (-180, -540, -500, 0, 80)],
)
def test_a_region_across_the_border_of_a_world_map_is_not_torn(
    tmp_path: Path, first: float, west: float, east: float, left: float, right: float
) -> None:
    photo = Photo(width=720, height=360, geo=Georeference("EPSG:4326", np.array([[0.5, 0, first], [0, -0.5, 90]])))
    feature = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [box(west, 0, east, 10)]}}
    data = collection(crs="EPSG:4326") | {"features": [feature]}
    path = write(tmp_path / "a.geojson", data)
    assert shape_of(open_regions(path).read(photo).regions[0]).bounds == pytest.approx((left, 160, right, 180))


@pytest.mark.parametrize(
    "name", ["EPSG:999999", "urn:ogc:def:crs:NONE::1", "/etc/passwd", "http://example.org/x", "PROJCS[", "ESRI:1"]
)
def test_unknown_reference_systems(tmp_path: Path, name: str) -> None:
    crs = {"type": "name", "properties": {"name": name}}
    refused(write(tmp_path / "a.geojson", collection(crs=crs)), "unknown reference system")


def test_mixed_reference_systems(tmp_path: Path) -> None:
    data = collection(crs="EPSG:32632")
    data["features"][1]["geometry"]["crs"] = "EPSG:32633"  # type: ignore[index]
    refused(write(tmp_path / "a.geojson", data), "mixes reference systems, EPSG:32632 and EPSG:32633")
    data = collection()
    data["features"][1]["crs"] = "EPSG:32633"  # type: ignore[index]
    refused(write(tmp_path / "b.geojson", data), "mixes reference systems, none and EPSG:32633")


def test_heights_are_said_to_be_dropped(tmp_path: Path) -> None:
    data = collection()
    data["features"][0]["geometry"]["coordinates"] = [[[x, y, 120.5] for x, y in box(2, 2, 9, 9)]]  # type: ignore[index]
    found = open_regions(write(tmp_path / "a.geojson", data)).read(UNPLACED)
    assert found.notes == ["a.geojson: heights (z) are not used, and not written again"]
    solid = shapely.from_wkt(["POLYGON Z ((1 1 5, 9 1 5, 9 9 5, 1 1 5))"])
    pyogrio.raw.write(
        tmp_path / "a.gpkg", shapely.to_wkb(solid, output_dimension=3), [], [], driver="GPKG", geometry_type="Polygon Z"
    )
    found = open_regions(tmp_path / "a.gpkg").read(UNPLACED)
    assert found.notes == ["a.gpkg: heights (z) are not used, and not written again"]
    assert shape_of(found.regions[0]).area == 32


def test_what_the_georeference_does_not_reach(tmp_path: Path) -> None:
    data = collection(crs="EPSG:4326")
    data["features"][0]["geometry"]["coordinates"] = [box(9, 95, 10, 96)]  # type: ignore[index]
    data["features"] = data["features"][:1]  # type: ignore[index]
    found = open_regions(write(tmp_path / "a.geojson", data)).read(PLACED)
    assert found.notes == ["1 region beyond the reach of the georeference left out"]
    assert shape_of(found.regions[0]) is None


def test_layers_are_chosen_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    layer(path, UTM.to_world, "EPSG:32632", True)
    pyogrio.raw.write(path, None, [np.arange(3)], ["n"], layer="table", driver="GPKG", append=False)
    assert len(open_regions(path).read(PLACED).regions) == 3  # a table is no layer of polygons
    boxes = shapely.to_wkb(np.array([shapely.box(500_001, 5_299_985, 500_009, 5_299_995)], object))
    pyogrio.raw.write(path, boxes, [], [], layer="sheds", driver="GPKG", geometry_type="Polygon", crs="EPSG:32632")
    refused(path, r"has 2 layers of polygons, houses, sheds: give one as .*a\.gpkg\|layername=houses")
    found = open_regions(f"{path}|layername=sheds").read(PLACED).regions
    assert [shape_of(region).bounds for region in found] == [(2, 10, 18, 30)]
    refused(f"{path}|layername=cars", "has no layer 'cars' of polygons: it has houses, sheds")
    assert PrecomputedSegmenter(f"{path}|layername=sheds").path == path
    refused(f"{write(tmp_path / 'a.json', collection())}|layername=x", "has no layers")


def test_pixels_with_y_up_or_down(tmp_path: Path) -> None:
    """QGIS draws a photograph without a georeference below y = 0; other programs keep y as it is."""
    for name, sign in (("up.gpkg", -1), ("down.gpkg", 1)):
        layer(tmp_path / name, lambda points, sign=sign: points * (1, sign), None, True)
        file = open_regions(tmp_path / name)
        found = file.read(PLACED)
        assert bool(found.notes) == (sign < 0)
        assert shape_of(found.regions[0]).bounds == (2.5, 2, 20, 20.25)
        out = tmp_path / name[:2]
        out.mkdir()
        write_regions(out, file, [CarriedRegion(found.regions[0], shape_of(found.regions[0]))], PLACED)
        assert np.sign(pyogrio.read_info(out / "regions.gpkg")["total_bounds"][1]) == sign


def test_our_own_geopackage_comes_back(tmp_path: Path) -> None:
    from zpm2.formats.gis import write_geopackage
    from zpm2.formats.layer import Layer
    from zpm2.model import Counterpart, Polygon

    polygon = Polygon(5, np.array([[2.0, 2], [20, 2], [20, 20]]), label="roof", score=0.5)
    sides = [Layer(name, [polygon], geo, {5: Counterpart(8, 5, 0.9)}, {}) for name, geo in
             (("left", UTM), ("right", Georeference()))]  # fmt: skip
    path = write_geopackage(tmp_path / "matches.gpkg", *sides, [])
    for name, photo in (("left", PLACED), ("right", UNPLACED)):
        (region,) = open_regions(f"{path}|layername={name}").read(photo).regions
        assert (region.id, region.source_id, region.label, region.score) == (5, "5", "roof", 0.5)
        assert shape_of(region).equals_exact(polygon.shape, 1e-6) or shape_of(region).equals(polygon.shape)


@pytest.mark.parametrize("name", ["a.gpkg", "a.shp"])
@pytest.mark.parametrize(
    "content", [b"", b"anything", b'<OGRVRTDataSource><OGRVRTLayer name="a"/></OGRVRTDataSource>', b"SQLite format 3\0"]
)
def test_files_of_other_drivers_are_not_opened(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    refused(tmp_path / name, "holds no regions that can be read")


def test_damaged_layers(tmp_path: Path) -> None:
    path = made("GeoPackage in UTM", tmp_path)
    path.write_bytes(path.read_bytes()[:5000])
    refused(path, "is damaged or not complete")
    path = made("shapefile", tmp_path)
    path.with_suffix(".shx").unlink()
    refused(path, "is damaged or not complete")


def test_an_empty_layer(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    pyogrio.raw.write(path, np.zeros(0, object), [], [], driver="GPKG", geometry_type="Polygon", crs="EPSG:32632")
    file = open_regions(path)
    assert file.read(PLACED).regions == []
    with pytest.raises(InputError, match="holds no region of the image"):
        PrecomputedSegmenter(path).polygons(Image(np.zeros((HEIGHT, WIDTH, 3), np.uint8), geo=UTM))
    (tmp_path / "out").mkdir()
    write_regions(tmp_path / "out", file, [], PLACED)
    assert open_regions(tmp_path / "out" / "regions.gpkg").read(PLACED).regions == []


@pytest.mark.parametrize("name", ["GeoJSON in UTM", "GeoPackage in UTM", "GeoJSON in degrees"])
def test_a_right_photograph_without_georeference_gets_pixels_and_a_note(tmp_path: Path, name: str) -> None:
    file = open_regions(made(name, tmp_path))
    regions = file.read(PLACED).regions
    right = Photo("right.png")
    (tmp_path / "out").mkdir()
    notes = write_regions(tmp_path / "out", file, [CarriedRegion(r, shape_of(r)) for r in regions], right)
    assert notes == ["right.png has no georeference: its regions are in pixels"]
    back = open_regions(tmp_path / "out" / file.names("regions")[0]).read(right).regions
    for one, other in zip(regions, back, strict=True):
        a, b = shape_of(one), shape_of(other)
        assert (a is None) == (b is None)
        assert a is None or a.symmetric_difference(b).area < 0.2


def test_a_reference_system_without_a_code_is_written_as_degrees(tmp_path: Path) -> None:
    wkt = pytest.importorskip("rasterio.crs").CRS.from_proj4("+proj=tmerc +lon_0=9 +k=0.9996 +x_0=500000").to_wkt()
    right = Photo("right.png", geo=Georeference(wkt, UTM.transform))
    file = open_regions(made("GeoJSON in UTM", tmp_path))
    regions = file.read(PLACED).regions
    (tmp_path / "out").mkdir()
    assert write_regions(tmp_path / "out", file, [CarriedRegion(r, shape_of(r)) for r in regions], right) == []
    data = json.loads((tmp_path / "out" / "regions.geojson").read_text())
    assert "crs" not in data
    assert data["features"][0]["geometry"]["coordinates"][0][0][0] == pytest.approx(9, abs=0.01)


def test_times_and_binary_columns(tmp_path: Path) -> None:
    """A time keeps its zone, which is UTC in a GeoPackage; what no column of ours can hold is said to be left out."""
    path = tmp_path / "a.gpkg"
    boxes = shapely.to_wkb(np.array([shapely.box(1, 1, 9, 9)], object))
    pyogrio.raw.write(path, boxes, [np.array(["2020-01-01T10:00:00.5"], "datetime64[ms]")], ["seen"], driver="GPKG",
                      geometry_type="Polygon", gdal_tz_offsets={"seen": np.array([100])})  # fmt: skip
    with contextlib.closing(sqlite3.connect(path)) as database:
        for (name,) in database.execute("select name from sqlite_master where type = 'trigger'").fetchall():
            database.execute(f'drop trigger "{name}"')  # they need functions of GDAL
        database.execute("alter table a add column picture blob")
        database.execute("update a set picture = x'0102'")
        database.commit()
    file = open_regions(path)
    found = file.read(UNPLACED)
    assert found.notes == ["a.gpkg: picture (binary) not read, and not written again"]
    assert found.regions[0].properties == {"seen": "2020-01-01T10:00:00.500"}
    (tmp_path / "out").mkdir()
    write_regions(tmp_path / "out", file, [CarriedRegion(found.regions[0], shape_of(found.regions[0]))], UNPLACED)
    with contextlib.closing(sqlite3.connect(tmp_path / "out" / "regions.gpkg")) as database:
        assert database.execute("select seen from a").fetchall() == [("2020-01-01T10:00:00.500Z",)]


@pytest.mark.parametrize("crs", [None, "EPSG:32632"])
def test_a_photograph_that_is_placed_by_its_rpc(tmp_path: Path, crs: str | None) -> None:
    from rasterio.rpc import RPC

    line, sample = [0.0, 0, -1, *[0.0] * 17], [0.0, 1, *[0.0] * 18]
    one = [1.0, *[0.0] * 19]
    rpc = RPC(0, 1, 47.85, 0.01, one, line, 20, 20, 9, 0.01, one, sample, 30, 30).to_dict()
    photo = Photo(geo=Georeference(rpc=rpc))
    degrees = moved(collection(), lambda xy: np.column_stack([9 + (xy[:, 0] - 30) * 0.01 / 30,
                                                             47.85 - (xy[:, 1] - 20) * 0.01 / 20]))  # fmt: skip
    data = degrees if crs is None else moved(degrees, lambda xy: between("EPSG:4326", "EPSG:32632", xy)) | {"crs": crs}
    file = open_regions(write(tmp_path / "a.geojson", data))
    regions = file.read(photo).regions
    corners = shapely.get_coordinates(shape_of(regions[0]))
    assert np.ptp(corners, axis=0) == pytest.approx((17.5, 18.25), abs=0.01)
    (tmp_path / "out").mkdir()
    assert write_regions(tmp_path / "out", file, [CarriedRegion(r, shape_of(r)) for r in regions], photo) == []
    back = open_regions(tmp_path / "out" / "regions.geojson").read(photo).regions
    assert shape_of(back[0]).symmetric_difference(shape_of(regions[0])).area < 0.05
