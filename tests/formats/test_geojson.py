import json

import numpy as np
import pytest
import shapely

from zpm2.errors import InputError, OutputError
from zpm2.formats import geojson
from zpm2.model import Counterpart, Polygon
from zpm2.polygons.shapes import from_shape

frame = shapely.Polygon(
    [(1 / 3, 2), (40, 2.25), (41, 30), (2, 31)], [[(10, 10), (20, 10), (20, 20)], [(5, 20), (8, 20), (8, 25)]]
)
POLYGONS = [
    from_shape(frame, 3, 0.93, "Dach, grün"),
    Polygon(8, np.array([[0, 0], [4, 0], [4, 4.0]]), (), 0.5, parent=3),
]


def collection(match_of=None):
    return geojson.feature_collection(POLYGONS, match_of, "left.png", 64, 48)


def test_properties_and_matches():
    first, second = collection({3: Counterpart(3, 11, 0.75)})["features"]
    assert first["id"] == 3
    assert first["properties"] == {
        "area": POLYGONS[0].area,
        "score": 0.93,
        "parent": None,
        "label": "Dach, grün",
        "match": 11,
        "match_id": 3,
        "confidence": 0.75,
        "unmatched": None,
    }
    assert (second["properties"]["match"], second["properties"]["confidence"]) == (None, None)
    assert second["properties"]["parent"] == 3


def test_rings_are_closed_and_turn_as_the_standard_wants():
    for feature in collection()["features"]:
        exterior, *holes = feature["geometry"]["coordinates"]
        assert shapely.LinearRing(exterior).is_ccw
        assert not any(shapely.LinearRing(hole).is_ccw for hole in holes)
        assert all(ring[0] == ring[-1] for ring in (exterior, *holes))
    assert shapely.from_geojson(json.dumps(collection()["features"][0]["geometry"])).equals(frame)


def test_the_frame_and_the_image_are_named():
    data = collection()
    assert data["crs"] is None
    assert "px" in data["coordinate_frame"]
    assert data["image"] == {"name": "left.png", "width": 64, "height": 48}
    # RFC 7946, 7.1: members of other GeoJSON types must not appear here
    assert not {"coordinates", "geometries", "geometry", "properties"} & set(data)


def test_every_bit_comes_back(tmp_path):
    path = geojson.write(tmp_path / "left.geojson", collection())
    text = path.read_text(encoding="utf-8")
    assert json.loads(text) == collection()
    assert "grün" in text
    back = geojson.parse(json.loads(text), "left.geojson")
    assert back.size == (64, 48)
    for feature, polygon in zip(back.features, POLYGONS, strict=True):
        assert (feature.id, feature.score, feature.label) == (polygon.id, polygon.score, polygon.label)
        for ring, original in zip(feature.parts[0], (polygon.exterior, *polygon.holes), strict=True):
            assert np.array_equal(ring, original)


def test_no_polygons_make_a_valid_file(tmp_path):
    path = geojson.write(tmp_path / "empty.geojson", geojson.feature_collection([], None, "a.png", 5, 5))
    assert json.loads(path.read_text())["features"] == []


def test_a_file_that_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match="cannot write"):
        geojson.write(tmp_path / "missing" / "left.geojson", collection())


@pytest.mark.parametrize(
    ("given", "expected"),
    [(7, 7), ("7", 7), (-1, None), (True, None), ("x7", None), (1.5, None), (None, None), ("9" * 5000, None)],
)
def test_ids(given, expected):
    data = {"type": "FeatureCollection", "features": [{"type": "Feature", "id": given, "geometry": None}]}
    assert geojson.parse(data, "a.geojson").features[0].id == expected


def test_heights_are_dropped_and_multipolygons_split():
    ring = [[0, 0, 9], [4, 0, 9], [4, 4, 9], [0, 0, 9]]
    data = {
        "type": "FeatureCollection",
        "features": [
            {"properties": {"id": 5}, "geometry": {"type": "MultiPolygon", "coordinates": [[ring], [ring]]}},
            {"geometry": {"type": "Point", "coordinates": [1, 2]}},
        ],
    }
    multi, point = geojson.parse(data, "a.geojson").features
    assert multi.id == 5
    assert [part[0].tolist() for part in multi.parts] == [[[0, 0], [4, 0], [4, 4]]] * 2
    assert point.parts == ()


@pytest.mark.parametrize("data", [None, [], "x", {}, {"features": []}, {"type": "FeatureCollection"}])
def test_what_is_no_collection(data):
    with pytest.raises(InputError, match=r"a\.geojson is not a GeoJSON FeatureCollection"):
        geojson.parse(data, "a.geojson")


@pytest.mark.parametrize(
    "ring",
    [
        [[0, 0], [4, float("nan")], [4, 4]],
        [[0, 0], [4, float("inf")], [4, 4]],
        [[0, 0], [1e300, 4], [4, 4]],
        [[0, 0], [None, 4], [4, 4]],
        [[0, 0], [4], [4, 4]],
        [[0], [4], [4], [4]],
        [[0, 0], ["a", "b"], [4, 4]],
        [{"x": 1}, {"x": 2}, {"x": 3}],
        [1, 2, 3],
        "ring",
        7,
        None,
    ],
)
def test_broken_rings_name_the_feature(ring):
    feature = {"geometry": {"type": "Polygon", "coordinates": [ring]}}
    with pytest.raises(InputError, match=r"feature 0 of a\.geojson has") as caught:
        geojson.parse({"type": "FeatureCollection", "features": [feature]}, "a.geojson")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "feature",
    [
        7,
        {"geometry": 7},
        {"properties": 7},
        {"geometry": {"type": "Polygon"}},
        {"geometry": {"type": "Polygon", "coordinates": 7}},
        {"geometry": {"type": "MultiPolygon", "coordinates": [7]}},
        {"geometry": None, "properties": {"score": "good"}},
        {"geometry": None, "properties": {"score": -1}},
        {"geometry": None, "properties": {"score": float("nan")}},
    ],
)
def test_broken_features(feature):
    with pytest.raises(InputError, match=r"feature 0 of a\.geojson"):
        geojson.parse({"type": "FeatureCollection", "features": [feature]}, "a.geojson")
