import dataclasses
import json
import sqlite3
import sys
import warnings

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.errors import InputError, MissingDependency, OutputError
from zpm2.formats import geojson, gis
from zpm2.formats.layer import Layer, feature_collection, world_shapes
from zpm2.model import Counterpart, Georeference, Polygon, PolygonMatch
from zpm2.polygons.shapes import from_shape

pyogrio = pytest.importorskip("pyogrio")
warp = pytest.importorskip("rasterio.warp")

NORTH_UP = np.array([[0.1, 0, 500_000.0], [0, -0.1, 5_300_000.0]])
SOUTH_UP = np.array([[0.1, 0, 500_000.0], [0, 0.1, 5_300_000.0]])
ROTATED = np.array([[0.08, 0.06, 500_000.0], [0.06, -0.08, 5_300_000.0]])
MIRRORED = np.array([[-0.1, 0, 500_000.0], [0, -0.1, 5_300_000.0]])
SITE = 'LOCAL_CS["site",UNIT["metre",1]]'

frame = shapely.Polygon(
    [(1 / 3, 2), (40, 2.25), (41, 30), (2, 31)], [[(10, 10), (20, 10), (20, 20)], [(5, 20), (8, 20), (8, 25)]]
)
POLYGONS = [
    from_shape(frame, 3, 0.93, "Dach, grün"),
    Polygon(8, np.array([[0, 0], [4, 0], [4, 4.0]]), (), 0.5, parent=3),
    Polygon(2**53 - 1, np.array([[50, 0], [54, 0], [54, 4], [52, 1.0]])),
]
SHAPES = np.array([p.shape for p in POLYGONS], object)
AREAS = shapely.area(SHAPES)
MATCHES = [PolygonMatch(3, 11, 0.75, 0.2, 9, "global", 0.8), PolygonMatch(8, 12, 0.5, 0.4, 0, "guided")]
FIELDS = [
    "polygon_id",
    "area_px",
    "area_m2",
    "score",
    "parent",
    "label",
    "match",
    "match_id",
    "confidence",
    "unmatched",
]


def layer(geo, name="left", polygons=POLYGONS):
    return Layer(name, polygons, geo, {3: Counterpart(3, 11, 0.75)}, {8: "beyond the other photograph"})


def utm(transform=NORTH_UP, gsd=0.1):
    return Georeference("EPSG:32632", transform, gsd)


def read(path, name=None):
    """CRS, shapes (None for a table) and {field: list of values} with None for null."""
    meta, _, wkb, columns = pyogrio.raw.read(path, layer=name)
    values = [[None if v is None or v != v else v for v in column.tolist()] for column in columns]
    shapes = None if wkb is None else shapely.from_wkb(wkb)
    return meta["crs"], shapes, dict(zip(meta["fields"].tolist(), values, strict=True))


def is_right_handed(shape):
    return shape.exterior.is_ccw and not any(hole.is_ccw for hole in shape.interiors)


def packed(tmp_path, left, right=None, matches=()):
    return gis.write_geopackage(tmp_path / "a.gpkg", left, right or layer(Georeference(), "right", []), matches)


def test_geopackage_fields(tmp_path):
    path = packed(tmp_path, layer(utm()), matches=MATCHES)
    assert [name for name, _ in pyogrio.list_layers(path).tolist()] == ["left", "right", "matches"]
    crs, shapes, fields = read(path, "left")
    assert crs == "EPSG:32632"
    assert shapely.area(shapes) == pytest.approx(AREAS * 0.01, rel=1e-6)
    assert list(fields) == FIELDS
    assert fields["polygon_id"] == [3, 8, 2**53 - 1]
    assert fields["area_px"] == AREAS.tolist()
    assert fields["area_m2"] == pytest.approx(AREAS * 0.01, rel=1e-12)
    assert fields["score"] == [0.93, 0.5, 1.0]
    assert fields["parent"] == [None, 3, None]
    assert fields["label"] == ["Dach, grün", None, None]
    assert fields["match"] == [11, None, None]
    assert fields["match_id"] == [3, None, None]
    assert fields["confidence"] == [0.75, None, None]
    assert fields["unmatched"] == [None, "beyond the other photograph", None]


GIVEN = [
    {"name": "Hof", "storeys": 3, "Area_px": 12, "fid": 1, "flat": True, "share": 1, "tags": ["a", "ü"]},
    {"name": None, "storeys": None, "Area_px": 7, "fid": 1, "flat": False, "share": 0.5, "tags": "none", "big": 2**70},
    {"Name": 5, "a name longer than ten": 1},
]


@pytest.mark.parametrize("form", ["gpkg", "shp"])
def test_ids_and_properties_of_given_regions(tmp_path, form):
    """One column each, null where a region has none; names that are ours get a prefix."""
    polygons = [
        dataclasses.replace(polygon, source_id=f"way/{k}", properties=given)
        for k, (polygon, given) in enumerate(zip(POLYGONS, GIVEN, strict=True))
    ]
    given = layer(utm(), polygons=polygons)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = packed(tmp_path, given) if form == "gpkg" else gis.write_shapefile(tmp_path, given)
    fields = read(path, "left")[2]
    assert [name for name in fields if name in FIELDS] == FIELDS
    assert fields["polygon_id"] == [3, 8, 2**53 - 1]
    assert fields["source_id"] == ["way/0", "way/1", "way/2"]
    assert fields["name"] == ["Hof", None, None]
    assert fields["storeys"] == [3, None, None]
    assert fields["share"] == [1, 0.5, None]
    assert fields["tags"] == ['["a", "ü"]', "none", None]
    assert fields["big"] == [None, str(2**70), None]
    if form == "gpkg":
        assert fields["flat"] == [True, False, None]
        assert fields["source_Area_px"] == [12, 7, None]
        assert fields["source_fid"] == [1, 1, None]
        assert fields["source_Name"] == [None, None, 5]
        assert fields["a name longer than ten"] == [None, None, 1]
    else:
        assert len(fields) == len(FIELDS) + 1 + len({name for row in GIVEN for name in row})


NASTY = ['a"; DROP TABLE "left"; --', "it's", "=1+1", "</b>", "a\nb", "]]>", "%s{}", "\u2028", '\\"']


@pytest.mark.parametrize("text", NASTY)
def test_names_are_data_whatever_they_hold(tmp_path, text):
    """In column names what cannot be printed is a blank."""
    ring = np.array([[0, 0], [4, 0], [4, 4.0]])
    polygon = Polygon(1, ring, (), 0.5, label=text, source_id=text, properties={text: text})
    left = layer(utm(), polygons=[polygon])
    packed(tmp_path, left)
    column = "".join(letter if letter.isprintable() else " " for letter in text)
    with sqlite3.connect(tmp_path / "a.gpkg") as base:
        base.row_factory = sqlite3.Row
        (row,) = base.execute('SELECT * FROM "left"')
    assert [row[name] for name in ("label", "source_id", column)] == [text] * 3
    gis.write_shapefile(tmp_path, left)
    meta, _, _, columns = pyogrio.raw.read(tmp_path / "left.shp")
    assert dict(zip(meta["fields"], columns, strict=True))["label"].tolist() == [text]
    again = json.loads(geojson.write(tmp_path / "a.geojson", feature_collection(left)).read_text(encoding="utf-8"))
    assert again["features"][0]["properties"][text] == text


@pytest.mark.parametrize("count", [150, 300, 2100])
def test_more_properties_than_a_format_holds(tmp_path, count):
    """The first ones are there, under names of their own, and that some are missing is said."""
    names = [f"Straße und Hausnummer {k}" for k in range(count)]
    given = layer(utm(), polygons=[dataclasses.replace(POLYGONS[0], properties=dict.fromkeys(names, 7))])
    table = read(packed(tmp_path, given), "left")[2]
    assert [name for name in table if name in names] == names[:1900]
    shape = read(gis.write_shapefile(tmp_path, given))[2]
    own = set(shape) - set(FIELDS)
    assert len(own) == min(count, 230)
    assert all(shape[name] == [7] and len(name.encode()) <= 10 for name in own)
    said = f"left regions: of their {count} properties a shapefile has the first 230"
    assert [note.startswith(said) for note in gis.messages([given])] == ([True] if count > 230 else [])


def test_no_regions_were_given_no_column_says_so(tmp_path):
    assert "source_id" not in read(packed(tmp_path, layer(utm())), "left")[2]


def test_geopackage_matches_join_by_id(tmp_path):
    path = packed(tmp_path, layer(utm()), matches=MATCHES)
    crs, shapes, fields = read(path, "matches")
    assert crs is None
    assert shapes is None
    assert fields == {"match_id": [3, 8]} | {
        name: [getattr(m, name) for m in MATCHES]
        for name in ("left", "right", "confidence", "cost", "dsf", "stage", "overlap")
    }
    with sqlite3.connect(path) as database:
        joined = 'SELECT "left".label FROM "left" JOIN matches ON "left".polygon_id = matches."left" ORDER BY dsf'
        assert database.execute(joined).fetchall() == [(None,), ("Dach, grün",)]


def test_each_layer_has_the_crs_of_its_photograph(tmp_path):
    right = layer(Georeference("EPSG:4326", np.array([[1e-6, 0, 9.0], [0, -1e-6, 47.5]])), "right")
    path = packed(tmp_path, layer(utm()), right)
    assert [read(path, name)[0] for name in ("left", "right")] == ["EPSG:32632", "EPSG:4326"]
    bounds = shapely.total_bounds(read(path, "right")[1])
    assert bounds == pytest.approx([9, 47.5 - 31e-6, 9 + 54e-6, 47.5], abs=1e-12)
    assert read(path, "right")[2]["area_m2"] == [None] * 3


@pytest.mark.parametrize("transform", [NORTH_UP, SOUTH_UP, ROTATED, MIRRORED])
def test_transforms(tmp_path, transform):
    geo = utm(transform)
    path = packed(tmp_path, layer(geo))
    for shapes in (world_shapes(layer(geo)), read(path, "left")[1]):
        assert all(map(is_right_handed, shapes))
        assert shapely.area(shapes) == pytest.approx(AREAS * 0.01, rel=1e-6)
        back = shapely.transform(shapes, geo.to_image)
        assert shapely.equals_exact(shapely.normalize(back), shapely.normalize(SHAPES), 1e-6).all()


@pytest.mark.parametrize("geo", [Georeference(), Georeference(gsd=0.5), Georeference("EPSG:32632"), utm(None)])
def test_without_georeference_the_layer_lies_where_a_gis_draws_the_image(tmp_path, geo):
    path = packed(tmp_path, layer(geo))
    _, shapes, fields = read(path, "left")
    assert all(map(is_right_handed, shapes))
    mirrored = shapely.transform(SHAPES, lambda xy: xy * (1, -1))
    assert shapely.equals(shapes, mirrored).all()
    assert fields["area_m2"] == (AREAS * geo.gsd**2 if geo.gsd else np.full(3, None)).tolist()
    with sqlite3.connect(path) as database:
        srs = dict(database.execute("SELECT table_name, srs_id FROM gpkg_geometry_columns").fetchall())
        version = database.execute("PRAGMA user_version").fetchone()
    assert srs == {"left": -1, "right": -1}  # the undefined Cartesian one
    assert version == (10200,)  # that older GISs read
    assert read(gis.write_shapefile(tmp_path, layer(geo)))[0] is None


def test_area_by_the_crs_where_nothing_says_the_gsd(tmp_path):
    feet = Georeference("EPSG:2227", np.array([[0.5, 0, 6e6], [0, -0.5, 2e6]]))
    assert read(packed(tmp_path, layer(feet)), "left")[2]["area_m2"] == pytest.approx(
        AREAS * (0.5 * 1200 / 3937) ** 2, rel=1e-9
    )


def test_a_local_system(tmp_path):
    site = layer(Georeference(SITE, NORTH_UP, 0.1))
    crs, shapes, _ = read(packed(tmp_path, site), "left")
    assert "site" in crs
    assert shapely.area(shapes) == pytest.approx(AREAS * 0.01, rel=1e-6)
    with pytest.raises(InputError, match="left image") as caught:
        feature_collection(site)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("geo", [utm(), Georeference()])
def test_no_polygons(tmp_path, geo):
    none = layer(geo, polygons=[])
    assert world_shapes(none).shape == (0,)
    path = packed(tmp_path, none)
    for name in ("left", "right", "matches"):
        assert not read(path, name)[2]["left" if name == "matches" else "polygon_id"]
    _, shapes, fields = read(gis.write_shapefile(tmp_path, none))
    assert len(shapes) == 0
    assert list(fields) == FIELDS
    if geo.located:
        assert read(path, "left")[0] == "EPSG:32632"
        assert feature_collection(none) == {"type": "FeatureCollection", "features": []}


@pytest.mark.parametrize("transform", [NORTH_UP, SOUTH_UP, ROTATED])
def test_shapefile(tmp_path, transform):
    path = gis.write_shapefile(tmp_path, layer(utm(transform)))
    assert path == tmp_path / "left.shp"
    assert {p.suffix for p in tmp_path.iterdir()} == {".shp", ".shx", ".dbf", ".prj", ".cpg"}
    crs, shapes, fields = read(path)
    assert crs == "EPSG:32632"
    assert shapely.equals_exact(shapely.normalize(shapes), shapely.normalize(world_shapes(layer(utm(transform))))).all()
    packed_fields = read(packed(tmp_path, layer(utm(transform))), "left")[2]
    assert list(fields) == FIELDS
    for name in FIELDS:
        if name in ("area_px", "area_m2", "score", "confidence"):
            known = [k for k, value in enumerate(fields[name]) if value is not None]
            assert [fields[name][k] for k in known] == pytest.approx([packed_fields[name][k] for k in known], rel=1e-12)
            assert [v is None for v in fields[name]] == [v is None for v in packed_fields[name]]
        else:
            assert fields[name] == packed_fields[name]


def test_shapefile_of_large_areas_and_long_text(tmp_path):
    square = np.array([[0, 0], [23_000, 0], [23_000, 15_000], [0, 15_000.0]])
    big = Layer("right", [Polygon(0, square, label="ü" * 300)], utm(gsd=1 / 3), {}, {0: "x" * 300})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fields = read(gis.write_shapefile(tmp_path, big))[2]
    assert fields["area_px"] == [23_000 * 15_000]
    assert fields["area_m2"] == pytest.approx([23_000 * 15_000 / 9], rel=1e-9)
    assert fields["label"] == ["ü" * 127]
    assert fields["unmatched"] == ["x" * 254]


def test_an_earlier_shapefile_leaves_no_side_file(tmp_path):
    gis.write_shapefile(tmp_path, layer(utm()))
    (tmp_path / "left.qix").write_bytes(b"spatial index of other polygons")
    (tmp_path / "right.prj").write_text("not ours")
    gis.write_shapefile(tmp_path, layer(Georeference()))
    assert {p.name for p in tmp_path.iterdir()} == {"left.shp", "left.shx", "left.dbf", "left.cpg", "right.prj"}


def test_geographic_features():
    collection = feature_collection(layer(utm(ROTATED)))
    assert set(collection) == {"type", "features"}  # no "crs": RFC 7946 has one only
    plain = geojson.feature_collection(POLYGONS, {3: Counterpart(3, 11, 0.75)}, "left.png", 64, 48)["features"]
    for feature, other, reason in zip(
        collection["features"], plain, [None, "beyond the other photograph", None], strict=True
    ):
        own = {"area_m2": pytest.approx(other["properties"]["area"] * 0.01), "unmatched": reason}
        assert feature["properties"] == {**other["properties"], **own}
        assert feature["id"] == other["id"]
        assert all(ring[0] == ring[-1] for ring in feature["geometry"]["coordinates"])
    json.dumps(collection, allow_nan=False)


@pytest.mark.parametrize("transform", [NORTH_UP, SOUTH_UP, ROTATED, MIRRORED])
def test_geographic_coordinates(transform):
    coarse = transform * np.array([[100, 100, 1], [100, 100, 1]])  # 10 m per px: 8 decimals are nothing beside it
    features = feature_collection(layer(utm(coarse, 10.0)))["features"]
    shapes = shapely.from_geojson([json.dumps(feature["geometry"]) for feature in features])
    assert all(map(is_right_handed, shapes))
    x_min, y_min, x_max, y_max = shapely.total_bounds(shapes)
    assert 8.9 < x_min < x_max < 9.1  # the zone's central meridian is 9 degrees east
    assert 47.8 < y_min < y_max < 47.9
    vertices = shapely.get_coordinates(shapes)
    assert np.array_equal(vertices, np.round(vertices, 8))
    back = shapely.transform(shapes, lambda xy: np.array(warp.transform("EPSG:4326", "EPSG:32632", *xy.T)).T)
    assert shapely.area(back) == pytest.approx(AREAS * 100, rel=1e-4)
    expected = shapely.get_coordinates(world_shapes(layer(utm(coarse))))
    assert shapely.get_coordinates(back) == pytest.approx(expected, abs=2e-3)


def test_the_antimeridian_makes_no_jump():
    triangle = np.array([[0, 0], [4, 0], [4, 4.0]])
    polygons = [Polygon(0, triangle), Polygon(1, triangle[[1, 2, 0]]), Polygon(2, triangle + np.array([9, 0]))]
    geo = Georeference("EPSG:3832", np.array([[100, 0, 3_339_400.0], [0, -100, 0]]))  # PDC Mercator, 150 degrees east
    features = feature_collection(layer(geo, polygons=polygons))["features"]
    lon = [np.array(f["geometry"]["coordinates"][0])[:, 0] for f in features]
    assert lon[0].min() < 180 < lon[0].max()  # begins west of it
    assert lon[1].min() < -180 < lon[1].max()  # begins east of it
    assert (np.abs(lon[2]) < 180).all()
    assert max(map(np.ptp, lon)) < 0.01
    beyond = Georeference("EPSG:4326", np.array([[1e-3, 0, 190.0], [0, -1e-3, 0]]))  # longitudes from 0 to 360
    ring = feature_collection(layer(beyond, polygons=polygons[:1]))["features"][0]["geometry"]["coordinates"][0]
    assert sorted({x for x, _ in ring}) == [-170, -169.996]


def by_rpc(**changes):
    """A degree a px, south up, from 12 east and 40 north on; believed within 60 px and more around the 30th."""
    unit, east, north = [1.0] + [0.0] * 19, [0.0, 1.0] + [0.0] * 18, [0.0, 0.0, 1.0] + [0.0] * 17
    offsets = {"line_off": 29.5, "samp_off": 29.5, "line_scale": 30.0, "samp_scale": 30.0, "height_off": 321.0}
    ground = {"lat_off": 40.003, "long_off": 12.003, "lat_scale": 3e-3, "long_scale": 3e-3, "height_scale": 100.0}
    terms = {"line_num_coeff": north, "line_den_coeff": unit, "samp_num_coeff": east, "samp_den_coeff": unit}
    return Georeference(gsd=0.5, rpc={**offsets, **ground, **terms, "err_bias": None, "err_rand": None, **changes})


def test_placed_by_rpc(tmp_path):
    """In longitude and latitude at their mean height, and that is said."""
    placed = layer(by_rpc())
    assert (placed.crs, placed.by_rpc) == ("EPSG:4326", True)
    wanted = shapely.normalize(shapely.transform(SHAPES, lambda xy: xy * 1e-4 + [12, 40]))
    crs, shapes, fields = read(packed(tmp_path, placed), "left")
    assert crs == "EPSG:4326"
    assert shapely.equals_exact(shapely.normalize(shapes), wanted, 1e-8).all()
    assert fields["area_m2"] == pytest.approx(AREAS * 0.25)
    features = feature_collection(placed)["features"]
    written = shapely.from_geojson([json.dumps(feature["geometry"]) for feature in features])
    assert shapely.equals_exact(shapely.normalize(written), wanted, 2e-8).all()
    assert read(gis.write_shapefile(tmp_path, placed))[0] == "EPSG:4326"
    (note,) = gis.messages([placed])
    assert note.startswith(
        "left image: files for a GIS are in longitude and latitude at the mean height of its RPC, 321 m"
    )
    assert gis.messages([layer(Georeference()), layer(utm(), "right")]) == []


def test_rpcs_at_the_antimeridian_make_no_jump(tmp_path):
    placed = layer(by_rpc(long_off=180.0))
    for shape in (*world_shapes(placed), *read(packed(tmp_path, placed), "left")[1]):
        x0, _, x1, _ = shape.bounds
        assert x1 - x0 < 0.01


@pytest.mark.parametrize("rpc", [{"samp_scale": 5.0}, {"line_den_coeff": [1.0]}, {"unknown": 1}])
def test_rpcs_that_do_not_reach_the_polygons_leave_them_in_pixels(tmp_path, rpc):
    placed = layer(by_rpc(**rpc))
    assert placed.crs is None
    crs, shapes, _ = read(packed(tmp_path, placed), "left")
    assert "EPSG" not in str(crs)
    assert shapely.equals(shapes, shapely.transform(SHAPES, lambda xy: xy * (1, -1))).all()
    assert gis.messages([placed]) == [
        "left image: its RPC does not cover all of its polygons: files for a GIS are in image px"
    ]


def test_a_system_without_longitude_and_latitude_is_noted():
    (note,) = gis.messages([layer(Georeference(SITE, NORTH_UP, 0.1))])
    assert note == "left image: its reference system has no longitude and latitude: left.geojson is in image px"


def test_vertices_without_longitude_and_latitude():
    with pytest.raises(InputError, match="left image"):
        feature_collection(layer(utm(NORTH_UP * 1e9)))


ring = st.lists(st.tuples(*[st.integers(0, 50)] * 2), min_size=3, max_size=6, unique=True)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(ring, st.lists(ring, max_size=2)), max_size=4), st.booleans())
def test_rings_stay_in_order_and_keep_their_first_vertex(rings, mirrored):
    polygons = [
        Polygon(k, np.array(e, float), tuple(np.array(h, float) for h in holes)) for k, (e, holes) in enumerate(rings)
    ]
    geo = utm(np.array([[-1.0 if mirrored else 1.0, 0, 0], [0, -1, 0]]))
    for polygon, shape in zip(polygons, world_shapes(layer(geo, polygons=polygons)), strict=True):
        found = [shape.exterior, *shape.interiors]
        for k, (vertices, made) in enumerate(zip((polygon.exterior, *polygon.holes), found, strict=True)):
            xy = shapely.get_coordinates(made)
            assert np.array_equal(xy[0], geo.to_world(vertices[:1])[0])
            assert sorted(xy[1:].tolist()) == sorted(geo.to_world(vertices).tolist())
            twice = np.dot(xy[:-1, 0], xy[1:, 1]) - np.dot(xy[1:, 0], xy[:-1, 1])
            assert twice <= 0 if k else twice >= 0


def write_all(tmp_path, which):
    return packed(tmp_path, layer(utm())) if which == "gpkg" else gis.write_shapefile(tmp_path, layer(utm()))


@pytest.mark.parametrize("which", ["gpkg", "shp"])
def test_places_that_cannot_be_written(tmp_path, which):
    (tmp_path / "file").write_text("x")
    (tmp_path / "taken" / ("a.gpkg" if which == "gpkg" else "left.shp")).mkdir(parents=True)
    for folder, word in [
        ("missing", "does not exist"),
        ("file", "is a file, not a folder"),
        ("taken", "is a folder of"),
    ]:
        with pytest.raises(OutputError, match=f"cannot write .*{word}") as caught:
            write_all(tmp_path / folder, which)
        assert "\n" not in str(caught.value)
    assert len(list((tmp_path / "taken").iterdir())) == 1


@pytest.mark.parametrize("which", ["gpkg", "shp"])
@pytest.mark.parametrize(
    ("error", "expected", "word"),
    [
        (pyogrio.errors.DataLayerError("one\ntwo"), OutputError, "one two"),
        (pyogrio.errors.FeatureError("write: No space left on device"), OutputError, "the disk is full; free some"),
        (PermissionError(13, "no"), OutputError, "permission denied"),
        (KeyboardInterrupt("stopped"), KeyboardInterrupt, "stopped"),
    ],
)
def test_a_write_that_breaks_off_changes_nothing(tmp_path, monkeypatch, which, error, expected, word):
    write_all(tmp_path, which)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def break_off(path, *_args, **_options):
        path.write_bytes(b"half a file")
        raise error

    monkeypatch.setattr(pyogrio.raw, "write", break_off)
    with pytest.raises(expected, match=word) as caught:
        write_all(tmp_path, which)
    assert "\n" not in str(caught.value)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_full_disk_is_named_though_gdal_does_not(tmp_path, monkeypatch):
    def full(*_args, **_options):
        raise pyogrio.errors.DataSourceError("Failed to commit transaction")

    monkeypatch.setattr(pyogrio.raw, "write", full)
    with pytest.raises(OutputError, match="Failed to commit"):
        write_all(tmp_path, "gpkg")
    monkeypatch.setattr(gis.shutil, "disk_usage", lambda _: gis.shutil._ntuple_diskusage(10**9, 10**9, 4096))
    with pytest.raises(OutputError, match="the disk is full; free some space"):
        write_all(tmp_path, "gpkg")


def test_a_geopackage_is_replaced_with_its_log(tmp_path):
    packed(tmp_path, layer(utm()))
    (tmp_path / "a.gpkg-wal").write_bytes(b"of the earlier one")
    path = packed(tmp_path, layer(utm(), polygons=POLYGONS[:1]))
    assert [p.name for p in tmp_path.iterdir()] == ["a.gpkg"]
    assert read(path, "left")[2]["polygon_id"] == [3]


def test_missing_packages_are_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio.warp", None)
    with pytest.raises(MissingDependency, match=r'pip install "zpm2\[geo\]"'):
        feature_collection(layer(utm()))
    monkeypatch.setitem(sys.modules, "pyogrio.raw", None)
    with pytest.raises(MissingDependency, match=r'pip install "zpm2\[geo\]"'):
        packed(tmp_path, layer(utm()))
    assert not list(tmp_path.iterdir())
