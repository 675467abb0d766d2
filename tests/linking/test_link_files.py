"""Layers from files to files: reference systems, ids, odd geometries, and the command."""

import json

import numpy as np
import pytest
import shapely
from towns import PLACE, UTM, houses, moved, write

import zpm2
from zpm2 import linking
from zpm2.cli import app
from zpm2.errors import Failed, InputError
from zpm2.formats import gis
from zpm2.formats.table import Table
from zpm2.photos.geolocation import WGS84

pytest.importorskip("rasterio", reason="extra geo is not installed")
pyogrio = pytest.importorskip("pyogrio", reason="extra geo is not installed")

COUNT = 40


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """A folder with houses before and after, the second file with other ids and in another order."""
    folder = tmp_path_factory.mktemp("town")
    corners = houses(COUNT)
    write(folder / "before.geojson", corners)
    after = moved(corners, (6.0, -4.0), 2.0, 0.2)[::-1]
    names = [f"way/{COUNT - 1 - k}" for k in range(COUNT)]
    write(folder / "after.geojson", after, ids=names)
    write(folder / "after_degrees.geojson", after, WGS84, names)
    write(folder / "after_web.geojson", after, "EPSG:3857", names)
    write(folder / "elsewhere.geojson", houses(COUNT, 7))
    return folder


def link(monkeypatch, *words):
    """The exit code of the command."""
    monkeypatch.setattr("sys.argv", ["zpm2", "link", *map(str, words)])
    with pytest.raises(SystemExit) as done:
        app.main()
    return done.value.code


@pytest.mark.parametrize("name", ["after", "after_degrees", "after_web"])
def test_any_reference_system(town, name):
    result = zpm2.link(town / "before.geojson", town / f"{name}.geojson")
    assert len(result.links) >= COUNT - 1
    assert all(right == f"way/{left}" for left, right in result.ids())
    assert result.similarity.turn == pytest.approx(2.0, abs=0.2)
    dx, dy = np.mean([each.shift for each in result.links], axis=0)
    assert (dx, dy) == pytest.approx((6.0, -4.0), abs=0.3)


def test_layers_across_the_antimeridian(town, tmp_path):
    write(tmp_path / "before.geojson", houses(COUNT), WGS84)
    for name, file in (("before", tmp_path / "before.geojson"), ("after", town / "after_degrees.geojson")):
        collection = json.loads(file.read_text())
        for feature in collection["features"]:
            ring = np.array(feature["geometry"]["coordinates"][0])
            ring[:, 0] += 164.9989  # the houses' middle to 180 degrees
            feature["geometry"]["coordinates"] = [(ring - (360 * (ring > 180))).tolist()]
        (tmp_path / f"{name}.geojson").write_text(json.dumps(collection))
    result = zpm2.link(tmp_path / "before.geojson", tmp_path / "after.geojson")
    assert len(result.links) >= COUNT - 1
    assert all(right == f"way/{left}" for left, right in result.ids())
    assert float(result.frame.split("lon_0=")[1].split()[0]) == pytest.approx(180, abs=0.01)


def test_the_files(town, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert link(monkeypatch, town / "before.geojson", town / "after.geojson", "-o", out) == 0
    assert "links of 40 and 40 polygons" in capsys.readouterr().out
    document = json.loads((out / "links.json").read_text())
    assert document["schema"] == "zpm2-links/1"
    assert document["similarity"]["turn"] == pytest.approx(2.0, abs=0.2)
    assert document["similarity"]["sigma"]["shift"] < 0.2
    given = json.loads((town / "before.geojson").read_text())
    back = json.loads((out / "regions.geojson").read_text())
    assert back["crs"]["properties"]["name"].endswith("32633")
    links = {each["left"]: each for each in document["links"]}
    assert [f["id"] for f in back["features"]] == [f["id"] for f in given["features"]]
    for old, new in zip(given["features"], back["features"], strict=True):
        properties = new["properties"]
        assert properties["owner"] == old["properties"]["owner"]
        assert np.array(new["geometry"]["coordinates"]) == pytest.approx(np.array(old["geometry"]["coordinates"]))
        if str(new["id"]) in links:
            assert properties["zpm2_partner"] == f"way/{new['id']}"
            assert properties["zpm2_dx"] == links[str(new["id"])]["dx"]
        else:
            assert properties["zpm2_unmatched"]
    shifts = json.loads((out / "shifts.geojson").read_text())["features"]
    assert [shift["properties"]["id"] for shift in shifts] == [each["left"] for each in document["links"]]
    assert shifts[0]["properties"]["dx"] == pytest.approx(document["links"][0]["dx"], abs=0.01)


def test_the_same_command_gives_the_same_bytes(town, tmp_path):
    result = zpm2.link(town / "before.geojson", town / "after.geojson")
    again = zpm2.link(town / "before.geojson", town / "after.geojson")
    for k, each in enumerate((result, again)):
        each.save(tmp_path / str(k))
    for name in ("regions.geojson", "shifts.geojson"):
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes()
    assert result.to_dict() | {"timings": {}} == again.to_dict() | {"timings": {}}


def test_unrelated_layers_give_no_links_and_say_so(town, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert link(monkeypatch, town / "before.geojson", town / "elsewhere.geojson", "-o", out, "--json") == 0
    printed = capsys.readouterr()
    assert "warning: no links: " in printed.err
    assert json.loads(printed.out)["links"] == 0
    document = json.loads((out / "links.json").read_text())
    assert document["similarity"] is None
    assert document["failed"]["similarity"]
    assert document["links"] == []
    assert len(document["unmatched"]["left"]) == len(document["unmatched"]["right"]) == COUNT
    assert json.loads((out / "shifts.geojson").read_text())["features"] == []


def test_misuse_is_one_line(town, tmp_path, monkeypatch, capsys):
    good, pixels, empty = town / "before.geojson", tmp_path / "px.geojson", tmp_path / "empty.geojson"
    collection = json.loads(good.read_text())
    pixels.write_text(json.dumps(collection | {"crs": None}))
    empty.write_text(json.dumps(collection | {"features": []}))
    (tmp_path / "coco.json").write_text('{"annotations": []}')
    (tmp_path / "mars.geojson").write_text(
        json.dumps(collection | {"crs": {"type": "name", "properties": {"name": "Mars"}}})
    )
    for path, text in (
        (tmp_path / "none.gpkg", "does not exist"),
        (pixels, "no reference system"),
        (empty, "no polygon with an area"),
        (tmp_path / "coco.json", "no layer on the ground"),
        (tmp_path / "mars.geojson", "unknown reference system"),
    ):
        for words in ((path, good), (good, path)):
            assert link(monkeypatch, *words, "-o", tmp_path / "out") == 2
            err = capsys.readouterr().err
            assert text in err
            assert len(err.splitlines()) == 1
            assert not (tmp_path / "out").exists()


def test_a_geopackage_keeps_its_columns_and_multipolygons_holes_and_heights_are_read(town, tmp_path):
    corners = houses(COUNT) + PLACE
    shapes = np.array([*shapely.polygons(corners)], object)
    x, y = corners[0, 0]
    shapes[0] = shapely.MultiPolygon([shapes[0], shapely.box(x - 3, y - 12, x, y - 9)])
    middle = corners[1].mean(0)
    shapes[1] = shapely.Polygon(corners[1], [shapely.box(*(middle - 1), *(middle + 1)).exterior.coords])
    shapes[2] = None
    shapes = shapely.force_3d(shapes, 100.0)
    owners = np.array([f"owner {k}" for k in range(COUNT)], object)
    path = tmp_path / "before.gpkg"
    gis.write_file(path, "houses", Table({"owner": owners}, {}), shapes, UTM, "MultiPolygon Z")
    result = zpm2.link(path, town / "after.geojson")
    assert len(result.links) >= COUNT - 3
    assert all(int(left) - 1 == int(right.removeprefix("way/")) for left, right in result.ids())  # fids begin at 1
    assert "area" in result.unmatched[0][2]
    result.save(tmp_path / "out")
    meta, fids, wkb, columns = pyogrio.raw.read(tmp_path / "out" / "regions.gpkg", return_fids=True)
    table = dict(zip(meta["fields"], (column.tolist() for column in columns), strict=True))
    assert table["owner"] == owners.tolist()
    assert fids.tolist() == list(range(1, COUNT + 1))
    assert meta["crs"] == UTM
    assert table["zpm2_partner"][5] == "way/5"
    assert table["zpm2_partner"][2] is None
    assert len(shapely.from_wkb(wkb)[1].geoms[0].interiors) == 1


def test_an_opened_layer_serves_several_times(town):
    before = linking.open_layer(town / "before.geojson")
    assert len(zpm2.link(before, town / "after.geojson").links) >= COUNT - 1
    assert isinstance(zpm2.link(before, town / "elsewhere.geojson").similarity, Failed)
    with pytest.raises(InputError, match="does not exist"):
        zpm2.link(before, town / "none.geojson")
