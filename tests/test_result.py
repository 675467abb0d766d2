"""Results to files and back: nothing lost, nothing half-written, and one line for what cannot be read."""

import contextlib
import dataclasses
import json
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st
from listener import listening
from rendered import photograph

from zpm2 import MatchResult, Polygon, PolygonMatch
from zpm2.config import recorded
from zpm2.errors import ConfigError, Failed, InputError, OutputError
from zpm2.model import ImagePolygons, PointMatches
from zpm2.photos import reopen
from zpm2.photos.source import open_source

FILES = ["left.geojson", "matches.json", "overlay.png", "right.geojson", "unmatched.png"]


def square(id: int, x: float, side: float = 20.0, **more: Any) -> Polygon:
    return Polygon(id, np.array([[x, 10], [x + side, 10], [x + side, 10 + side], [x, 10 + side]]), **more)


def build(left: str | None = "left.png", right: str | None = "right.png") -> MatchResult:
    """A result with everything in it: holes, parents, labels, homologous vertices, one estimate that failed."""
    hole = np.array([[15.0, 15], [15, 18.25], [18, 18]])
    lefts = [square(3, 10, holes=(hole,), score=0.9, label="roof"), square(5, 12, 5.0, parent=3), square(9, 50 + 1 / 3)]
    rights = [square(0, 8), square(1, 48.125)]
    nodes = np.array([[0, 1], [2, 3]])
    outline = np.array([[10, 10, 8, 10, 0.125], [30, 10, 28, 10.5, 0], [30, 30.0, 28, 30, 0.001]])
    return MatchResult(
        left=ImagePolygons(100, 60, lefts, left),
        right=ImagePolygons(90, 70, rights, right),
        matches=[
            PolygonMatch(3, 1, 0.75, 0.125, 12, "global", 0.5, nodes, outline),
            PolygonMatch(9, 0, 0.3, 2.5, 0, "local"),
        ],
        points=PointMatches(np.array([[1.5, 2], [3, 4.1]]), np.array([[0.5, 2], [2, 4.3]]), np.array([1.0, 0.25])),
        fundamental=np.array([[0, -1e-7, 0.1], [1 / 3, 0, 2], [3, 4, 5]]),
        homography=Failed("only 2 homologous points"),
        config={"seed": 0},
        timings={"read": 0.12345678, "local": 1.0},
        warnings=["größer"],
    )


@pytest.fixture
def result(tmp_path: Path) -> MatchResult:
    """The same with photographs that exist."""
    PIL.Image.fromarray(photograph(1, 100, 60)).save(tmp_path / "left.png")
    PIL.Image.fromarray(photograph(2, 90, 70)).save(tmp_path / "right.png")
    return build(str(tmp_path / "left.png"), str(tmp_path / "right.png"))


def test_round_trip(result: MatchResult, tmp_path: Path) -> None:
    folder = result.save(tmp_path / "new" / "out")
    assert sorted(p.name for p in folder.iterdir()) == [".zpm2", *FILES]
    for path in (folder, str(folder), folder / "matches.json"):
        loaded = MatchResult.load(path)
        assert loaded.to_dict() == result.to_dict()
        assert loaded.to_geojson() == result.to_geojson()
    assert isinstance(loaded.homography, Failed)
    assert loaded.homography.reason == "only 2 homologous points"
    document = {name: value for name, value in result.to_dict().items() if name != "failed"}  # of an older version
    (tmp_path / "older.json").write_text(json.dumps(document))
    older = MatchResult.load(tmp_path / "older.json")
    assert older.homography == Failed("the run found no homography")
    assert np.array_equal(loaded.fundamental, result.fundamental)  # type: ignore[arg-type]
    assert loaded.left.polygons[0].area == 400 - shoelace(result.left.polygons[0].holes[0])
    assert np.array_equal(loaded.matches[0].nodes, [[0, 1], [2, 3]])
    assert loaded.matches[1].nodes.shape == (0, 2)
    assert np.array_equal(loaded.matches[0].outline, result.matches[0].outline)
    assert loaded.matches[1].outline.shape == (0, 5)
    again = tmp_path / "new" / "again"  # as far from the photographs
    assert loaded.save(again) == again
    for name in FILES:
        assert (again / name).read_bytes() == (folder / name).read_bytes()


def test_what_a_border_cuts_off_is_told_only_where_it_does(result: MatchResult, tmp_path: Path) -> None:
    cut = dataclasses.replace(result, matches=[dataclasses.replace(result.matches[0], visible=0.4), result.matches[1]])
    saved = json.loads((cut.save(tmp_path / "cut") / "matches.json").read_text())["matches"]
    assert [match.get("visible") for match in saved] == [0.4, None]
    assert [match.visible for match in MatchResult.load(tmp_path / "cut").matches] == [0.4, 1.0]


def shoelace(ring: np.ndarray[Any, Any]) -> float:
    x, y = ring.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


coordinates = st.floats(-1e6, 1e6, allow_nan=False)
rings = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=6).map(lambda v: np.array(v, np.float64))


@given(rings, st.floats(0, 1), st.floats(0, 1e300), st.integers(0, 2**53))
def test_numbers_keep_every_bit(
    tmp_path_factory: pytest.TempPathFactory, ring: Any, score: float, cost: float, id: int
) -> None:
    before = build()
    polygon = Polygon(id, ring, score=score)
    match = PolygonMatch(id, 1, score, cost, 3, "guided", score)
    points = PointMatches(ring, ring[::-1], np.full(len(ring), score))
    one = MatchResult(
        ImagePolygons(100, 60, [polygon]), before.right, [match], points, before.fundamental, before.homography, {}, {}
    )
    file = tmp_path_factory.mktemp("bits") / "matches.json"
    file.write_text(json.dumps(one.to_dict()))
    again = MatchResult.load(file)
    assert again.to_dict() == one.to_dict()
    assert again.left.polygons[0].exterior.tobytes() == ring.tobytes()
    assert again.points.right.tobytes() == points.right.tobytes()


def test_geojson_of_both_sides(result: MatchResult) -> None:
    collections = result.to_geojson()
    assert list(collections) == ["left", "right"]
    matched = {f["id"]: f["properties"]["match"] for f in collections["left"]["features"]}
    assert matched == {3: 1, 5: None, 9: 0}
    assert {f["id"]: f["properties"]["match"] for f in collections["right"]["features"]} == {0: 9, 1: 3}
    assert collections["right"]["image"] == {"name": result.right.path, "width": 90, "height": 70}
    assert build(None).to_geojson()["left"]["image"]["name"] == "left"


def test_saving_reads_each_photograph_once(
    result: MatchResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = MatchResult.load(result.save(tmp_path / "out"))
    opened: list[str] = []
    monkeypatch.setattr(reopen, "open_source", lambda path, *more: opened.append(path) or open_source(path, *more))
    loaded.save(tmp_path / "again")
    assert sorted(opened) == [str(tmp_path / "left.png"), str(tmp_path / "right.png")]


def test_plot_from_the_photographs_of_a_loaded_result(result: MatchResult, tmp_path: Path) -> None:
    loaded = MatchResult.load(result.save(tmp_path / "out"))
    picture = loaded.plot(max_width=600)
    assert max(picture.size) <= 600
    assert np.asarray(picture).std() > 10
    assert picture.tobytes() == result.plot(max_width=600).tobytes()


def test_plot_without_the_photographs(result: MatchResult, tmp_path: Path) -> None:
    loaded = MatchResult.load(result.save(tmp_path / "out"))
    PIL.Image.fromarray(photograph(2, 91, 70)).save(tmp_path / "right.png")
    with pytest.raises(InputError, match=r"right.png has 91 x 70 px and had 90 x 70 px"):
        loaded.plot()
    (tmp_path / "left.png").unlink()
    with pytest.raises(InputError, match=r"left image .*left.png does not exist"):
        loaded.plot()
    with pytest.raises(InputError, match="left photograph was given as pixels"):
        build(None).plot()


def test_a_result_that_cannot_be_drawn_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="given as pixels"):
        build(None).save(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_save_into_a_place_that_is_none(result: MatchResult, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match="output folder"):
            result.save(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read .*; give the folder that zpm2 match wrote"),
        (b"", "is not JSON"),
        (b'{"schema": "zpm2-ma', "is not JSON"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b"[]", "is not a zpm2-matches/1 file"),
        (b"{}", "is not a zpm2-matches/1 file"),
        (b'{"schema": "zpm2-matches/2"}', "is not a zpm2-matches/1 file"),
        (b'{"type": "FeatureCollection", "features": []}', "is not a zpm2-matches/1 file"),
        (b'{"schema": "zpm2-matches/1"}', "is not complete"),
    ],
)
def test_files_that_are_no_result(tmp_path: Path, content: bytes | None, words: str) -> None:
    if content is not None:
        (tmp_path / "matches.json").write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        MatchResult.load(tmp_path)
    assert str(tmp_path / "matches.json") in str(caught.value)
    assert "\n" not in str(caught.value)


def load(document: Any, tmp_path: Path) -> MatchResult:
    file = tmp_path / "matches.json"
    file.write_text(json.dumps(document))
    return MatchResult.load(file)


def places(value: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path of every member of nested lists and dictionaries."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, inner in items for place in [(*here, key), *places(inner, (*here, key))]]


def changed(place: tuple[Any, ...], change: Callable[[Any, Any], None]) -> Any:
    document = json.loads(json.dumps(build().to_dict()))
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    change(inner, place[-1])
    return document


def test_a_missing_member_is_named(tmp_path: Path) -> None:
    members = [p for p in places(build().to_dict()) if isinstance(p[-1], str) and p[0] not in ("config", "timings")]
    optional = {"label", "area", "nodes", "overlap", "non_overlapping", "outline", "crs", "transform", "gsd", "rpc"}
    optional |= {"failed", "source_id", "properties", "notes", "same_scene"}
    missed = [p for p in members if not optional & set(p) and not (p[0] == "matches" and p[-1] == "id")]
    assert len(missed) > 40
    for place in missed:
        with pytest.raises(InputError, match=rf"'?{place[-1]}'?|zpm2-matches"):
            load(changed(place, lambda inner, key: inner.pop(key)), tmp_path)


@pytest.mark.parametrize("value", [None, 5, -1.5, "x", [], {}, [[1, 2]], float("nan"), True])
def test_a_member_of_a_wrong_kind_is_an_input_error_or_harmless(tmp_path: Path, value: Any) -> None:
    """Whatever stands where, a result that loads can be written again."""
    refused = 0
    for place in places(build().to_dict()):
        document = changed(place, lambda inner, key: inner.__setitem__(key, value))
        try:
            found = load(document, tmp_path)
        except InputError:
            refused += 1
        else:
            found.to_dict()
            found.to_geojson()
    assert refused > 10


def test_a_plug_in_that_a_result_names_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A result of somebody else is data."""
    (tmp_path / "named_by_a_result.py").write_text("raise SystemExit('imported')\n")
    monkeypatch.syspath_prepend(tmp_path)
    named = {"segment": {"model": "named_by_a_result:A"}, "points": {"methods": ["named_by_a_result:A"]}}
    result = load(json.loads(json.dumps({**build().to_dict(), "config": named})), tmp_path)
    assert result.config == named
    assert recorded(result.config).segment.model == "named_by_a_result:A"
    assert "named_by_a_result" not in sys.modules


def overlapping() -> MatchResult:
    """Twice the same image, with a window (2) in a roof (1), a crossing region (4), and polygons without a match."""
    rings = {
        1: (10, 10, 70, 50),
        2: (20, 20, 35, 35),
        4: (60, 5, 80, 55),
        5: (0, 0, 30, 30),
        8: (22, 22, 24, 24),
    }
    polygons = [
        Polygon(
            k,
            np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64),
            parent={2: 1, 8: 2}.get(k),
            label="window" if k == 2 else None,
        )
        for k, (x0, y0, x1, y1) in rings.items()
    ]
    none = np.zeros((0, 2), np.int64)
    matches = [
        PolygonMatch(k, k, c, 1.0, 0, "global", 1.0, np.array([[0, 0]]) if k == 1 else none)
        for k, c in ((1, 0.9), (2, 0.6), (4, 0.8), (8, 0.7))
    ]
    side = ImagePolygons(100, 60, polygons)
    points = PointMatches(np.array([[15.0, 40]]), np.array([[15.0, 40]]), np.ones(1))
    return MatchResult(side, side, matches, points, Failed("no"), np.eye(3), {"segment": {"min_area": 50.0}}, {})


def areas(side: ImagePolygons) -> dict[int, float]:
    return {polygon.id: polygon.area for polygon in side.polygons}


def test_flatten_gives_exclusive_regions_and_says_so() -> None:
    before = overlapping()
    flat = before.flatten()
    for side in (flat.left, flat.right):
        # 8 lies in 2 and untouched by anybody, so it stays though it is small; 1 keeps what 2 and 8 leave, 4 the rest
        assert areas(side) == {1: 60 * 40 - 15 * 15, 2: 15 * 15 - 4, 4: 20 * 50 - 10 * 40, 5: 900, 8: 4}
    assert [(m.left, m.right, m.confidence) for m in flat.matches] == [
        (m.left, m.right, m.confidence) for m in before.matches
    ]
    assert all(len(match.nodes) == 0 for match in flat.matches)
    kept = {polygon.id: polygon for polygon in flat.left.polygons}
    assert (kept[2].parent, kept[8].parent, kept[2].label) == (1, 2, "window")
    assert kept[5] is before.left.polygons[3]
    assert (flat.non_overlapping, before.non_overlapping) == (True, False)
    assert flat.to_dict()["non_overlapping"] is True
    assert flat.flatten().to_dict() == flat.to_dict()


def test_flatten_leaves_out_matches_that_keep_too_little() -> None:
    before = overlapping()
    wide = dataclasses.replace(before, config={"segment": {"min_area": 700}})
    flat = wide.flatten()
    assert [match.left for match in flat.matches] == [1, 8]
    assert areas(flat.left) == {1: 60 * 40 - 4, 2: 225, 4: 1000, 5: 900, 8: 4}
    assert flat.notes == ["made non-overlapping, 2 of 4 matches lost their regions"]
    for config in ({}, {"segment": 3}, {"segment": {"min_area": None}}):
        usual = dataclasses.replace(before, config=config).flatten()
        assert [match.left for match in usual.matches] == [1, 2, 4, 8]


def test_a_least_area_of_nothing_is_not_the_usual_one() -> None:
    """Of the lower match 60 px stay: enough where the run asked for no least area, too little for the default."""
    rings = {1: (10, 10, 30, 30), 2: (10, 10, 30, 33)}
    polygons = [Polygon(k, np.array([[a, b], [c, b], [c, d], [a, d]], np.float64)) for k, (a, b, c, d) in rings.items()]
    matches = [PolygonMatch(k, k, 1 / k, 1.0, 0, "global", 1.0) for k in rings]
    before = dataclasses.replace(
        overlapping(), left=ImagePolygons(100, 60, polygons), right=ImagePolygons(100, 60, polygons), matches=matches
    )
    for config, kept in (({"segment": {"min_area": 0}}, [1, 2]), ({"segment": {"min_area": 0.0}}, [1, 2]), ({}, [1])):
        assert [m.left for m in dataclasses.replace(before, config=config).flatten().matches] == kept


def test_every_file_names_a_match_by_one_id(result: MatchResult, tmp_path: Path) -> None:
    """`PolygonMatch.id` beside the partner's polygon id, and why there is none, in every format."""
    pyogrio = pytest.importorskip("pyogrio")
    result = dataclasses.replace(
        result,
        left=dataclasses.replace(result.left, unmatched={5: "occluded"}),
        right=dataclasses.replace(result.right, polygons=[*result.right.polygons, square(4, 20)]),
    )
    folder = result.save(tmp_path / "out", ["gpkg", "shapefile", "coco"])
    for name, other in (("left", "right"), ("right", "left")):
        expected = {getattr(m, name): (getattr(m, other), m.id) for m in result.matches}
        side: ImagePolygons = getattr(result, name)
        assert 0 < len(expected) < len(side.polygons)
        rows = {p.id: (*expected.get(p.id, (None, None)), side.unmatched.get(p.id)) for p in side.polygons}
        members = "match", "match_id", "unmatched"
        features = json.loads((folder / f"{name}.geojson").read_text())["features"]
        assert {f["id"]: tuple(f["properties"][m] for m in members) for f in features} == rows
        annotations = json.loads((folder / f"{name}.coco.json").read_text())["annotations"]
        assert {a["polygon_id"]: tuple(a[m] for m in members) for a in annotations} == rows
        for path, layer in ((folder / "matches.gpkg", name), (folder / f"{name}.shp", None)):
            meta, _, _, columns = pyogrio.raw.read(path, layer=layer)
            table = dict(zip(meta["fields"].tolist(), columns, strict=True))
            read = zip(*(table[m].tolist() for m in ("polygon_id", *members)), strict=True)
            found = {id: tuple(None if v != v else v for v in row) for id, *row in read}
            assert found == rows
    meta, _, _, columns = pyogrio.raw.read(folder / "matches.gpkg", layer="matches")
    table = dict(zip(meta["fields"].tolist(), columns, strict=True))
    assert table["match_id"].tolist() == [m.id for m in result.matches]


def test_outlines_go_to_the_file_and_back(tmp_path: Path) -> None:
    outlined = overlapping().flatten().with_outlines()
    for match in outlined.matches:
        assert match.outline[:, :2] == pytest.approx(match.outline[:, 2:4], abs=1e-6)
    roof = outlined.matches[0].outline
    assert len(roof) == 100  # px of the exterior / step, whatever its holes
    assert len(overlapping().with_outlines(step=4.0).matches[0].outline) == 50
    file = tmp_path / "matches.json"
    file.write_text(json.dumps(outlined.to_dict()))
    again = MatchResult.load(file)
    assert again.non_overlapping
    assert again.to_dict() == outlined.to_dict()
    assert again.matches[0].outline == pytest.approx(roof, abs=0.0005)
    assert "outline" not in overlapping().to_dict()["matches"][0]


def test_flatten_and_outlines_of_nothing_and_of_a_broken_result() -> None:
    nothing = dataclasses.replace(overlapping(), matches=[])
    assert nothing.flatten().non_overlapping
    assert nothing.with_outlines().matches == []
    broken = dataclasses.replace(overlapping(), matches=[PolygonMatch(1, 77, 0.5, 1.0, 0, "global")])
    for call in (broken.flatten, broken.with_outlines):
        with pytest.raises(InputError, match="match 1 - 77 names a polygon that the result does not have"):
            call()
    for step in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="give a step above 0"):
            overlapping().with_outlines(step)


def test_a_notebook_shows_the_overlay(result: MatchResult) -> None:
    html = result._repr_html_()
    assert html.startswith("<code>MatchResult(")
    assert 'src="data:image/jpeg;base64,' in html


def test_a_notebook_says_why_there_is_no_overlay(result: MatchResult, tmp_path: Path) -> None:
    loaded = MatchResult.load(result.save(tmp_path))
    html = dataclasses.replace(loaded, left=dataclasses.replace(loaded.left, path="<gone>.png"))._repr_html_()
    assert "<img" not in html
    assert "&lt;gone&gt;.png" in html


def test_notes_come_back(result: MatchResult, tmp_path: Path) -> None:
    noted = dataclasses.replace(result, warnings=["act"], notes=["done"])
    loaded = MatchResult.load(noted.save(tmp_path))
    assert (loaded.warnings, loaded.notes) == (["act"], ["done"])
    document = noted.to_dict()
    del document["notes"]  # as an earlier version wrote it
    (tmp_path / "matches.json").write_text(json.dumps(document))
    assert MatchResult.load(tmp_path).notes == []


def test_a_contact_sheet_names_matches_by_their_ids(result: MatchResult, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(
        "zpm2.view.pictures.contact_sheet",
        lambda rows, captions: said.extend(captions) or np.zeros((4, 4, 3), np.uint8),
    )
    result.contact_sheet()
    assert said == [f"match {m.id}   (right {m.right})   {m.confidence:.2f}" for m in result.matches]


def test_sizes_of_pictures_that_cannot_be_are_refused(result: MatchResult) -> None:
    for draw in (
        lambda: result.plot(0),
        lambda: result.plot_unmatched(-1),
        lambda: result.contact_sheet(-1),
        lambda: result.contact_sheet(3, seed=-1),
    ):
        with pytest.raises(ConfigError, match="not "):
            draw()


def test_two_saves_give_the_same_bytes(result: MatchResult, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    folders = [result.save(tmp_path / name, ["gpkg", "shapefile", "coco"]) for name in ("one", "two")]
    files = [{path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} for folder in folders]
    assert {"matches.json", "matches.gpkg", "left.shp", "left.dbf", "overlay.png"} <= set(files[0])
    assert files[0] == files[1]
    assert files[0]["left.dbf"][1:4] == bytes([70, 1, 1])  # a date, which would be another one tomorrow
    assert pyogrio.get_gdal_config_option("OGR_CURRENT_DATE") is None


def test_a_time_that_the_user_told_gdal_stays(result: MatchResult, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    name, time = "OGR_CURRENT_DATE", "2001-02-03T04:05:06.000Z"
    pyogrio.set_gdal_config_options({name: time})
    try:
        folder = result.save(tmp_path / "out", ["gpkg"])
        assert pyogrio.get_gdal_config_option(name) == time
    finally:
        pyogrio.set_gdal_config_options({name: None})
    with contextlib.closing(sqlite3.connect(folder / "matches.gpkg")) as file:
        assert set(file.execute("select last_change from gpkg_contents")) == {(time,)}


@pytest.mark.parametrize(
    "crs", ["{url}/crs", "/vsicurl/{url}/crs", "crs.txt", "/etc/passwd", "IGNF:{url}", 3, ["EPSG:1"]]
)
def test_a_reference_system_is_no_address(tmp_path: Path, crs: Any) -> None:
    """GDAL would ask for it."""
    document = build().to_dict()
    with listening() as calls:
        document["left"]["crs"] = crs.format(url=calls.address) if isinstance(crs, str) else crs
        document["left"]["transform"] = [[1, 0, 0], [0, -1, 0]]
        (tmp_path / "matches.json").write_text(json.dumps(document))
        with pytest.raises(InputError):
            MatchResult.load(tmp_path)
    assert calls.calls == []
