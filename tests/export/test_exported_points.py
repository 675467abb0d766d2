"""Points of many pairs for COLMAP and hloc, read back by pycolmap and h5py."""

import hashlib
import itertools
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2 import MatchResult
from zpm2.errors import InputError, MissingDependency
from zpm2.export import collect, colmap, hloc
from zpm2.export.keypoints import Keypoints
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch

FOCAL, SIZE = 768.0, (640, 480)  # the focal length that COLMAP starts from: 1.2 times the width
SQUARE = np.array([[100, 100], [300, 100], [300, 300], [100, 300.0]])


def result(left: Path, right: Path, points: PointMatches) -> MatchResult:
    """A pair whose only match is one square in both photographs."""
    sides = [ImagePolygons(*SIZE, [Polygon(0, SQUARE)], str(path)) for path in (left, right)]
    match = PolygonMatch(0, 0, 0.9, 0.1, 1, "global")
    return MatchResult(sides[0], sides[1], [match], points, np.eye(3), np.eye(3), {}, {})


@pytest.fixture
def views(tmp_path: Path) -> list[MatchResult]:
    """All pairs of four photographs around 300 points, their names in two folders."""
    rng = np.random.default_rng(5)
    space = rng.uniform((-2, -1.5, 6), (2, 1.5, 9), (300, 3))
    photographs, seen = [], []
    for k in range(4):
        path = tmp_path / "photos" / ("day" if k % 2 else "night") / f"{k}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((SIZE[1], SIZE[0], 3), 60 * k, np.uint8))
        turn = cv2.Rodrigues(np.array([0, 0.15 * (k - 1.5), 0.02 * k]))[0]
        there = (space - (0, 0, 7.5)) @ turn.T + (0.05 * k, 0.1 * k, 7.5)
        photographs.append(path)
        seen.append(there[:, :2] / there[:, 2:] * FOCAL + (SIZE[0] / 2, SIZE[1] / 2))
    score = np.linspace(0.2, 0.9, 300)
    pairs = itertools.permutations(range(4), 2)  # both ways: each pair is one, with each match once
    return [result(photographs[i], photographs[j], PointMatches(seen[i], seen[j], score)) for i, j in pairs]


def test_a_point_is_one_keypoint_however_many_pairs_have_it(views: list[MatchResult], tmp_path: Path) -> None:
    found = collect(views)
    assert found.root == tmp_path / "photos"
    assert list(found.points) == ["day/1.png", "day/3.png", "night/0.png", "night/2.png"]
    assert [len(points) for points in found.points.values()] == [300] * 4
    assert [pair.names for pair in found.pairs] == list(itertools.combinations(found.points, 2))
    for pair in found.pairs:
        assert len(pair.rows) == 300
        assert sorted(pair.score) == pytest.approx(np.linspace(0.2, 0.9, 300))


ROWS = st.lists(st.tuples(*[st.integers(0, 3)] * 4), max_size=12)


@settings(max_examples=30)
@given(ROWS, ROWS)
def test_matches_are_those_of_the_results_each_once(tmp_path_factory: Any, one: list[Any], other: list[Any]) -> None:
    """Against sets of points: any duplicates, in one result and in two."""
    folder = tmp_path_factory.getbasetemp()
    a, b = folder / "a.png", folder / "b.png"
    for path in (a, b):
        path.touch()
    arrays = [np.array(rows, np.float64).reshape(-1, 4) for rows in (one, other)]
    results = [
        result(a, b, PointMatches(arrays[0][:, :2], arrays[0][:, 2:], np.ones(len(one)))),
        result(b, a, PointMatches(arrays[1][:, 2:], arrays[1][:, :2], np.ones(len(other)))),
    ]
    found = collect(results)
    (pair,) = found.pairs
    sides = [found.points[name][pair.rows[:, k]] for k, name in enumerate(pair.names)]
    rows = [tuple(row) for row in np.hstack(sides).tolist()]
    assert len(rows) == len(set(rows))
    assert set(rows) == {tuple(map(float, row)) for row in (*one, *other)}
    assert {tuple(p) for p in found.points["a.png"].tolist()} == {tuple(map(float, row[:2])) for row in (*one, *other)}


def test_only_points_inside_both_polygons_of_a_match(views: list[MatchResult]) -> None:
    found = collect(views[:1], matched=True)
    (pair,) = found.pairs
    square = shapely.Polygon(SQUARE)
    points = views[0].points
    inside = [shapely.contains_xy(square, *side.T) for side in (points.left, points.right)]
    assert 0 < len(pair.rows) == (inside[0] & inside[1]).sum() < 300


def test_the_database_is_ready_for_the_mapper(views: list[MatchResult], tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    found = collect(views)
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        colmap.write(found, tmp_path / name, seed=0)
    content = [
        hashlib.sha256((tmp_path / name / "database.db").read_bytes()).hexdigest() for name in ("first", "second")
    ]
    assert content[0] == content[1]
    models = pycolmap.incremental_mapping(tmp_path / "first" / "database.db", found.root, tmp_path)
    assert (models[0].num_reg_images(), models[0].num_points3D()) == (4, 300)
    assert models[0].compute_mean_reprojection_error() < 0.1
    assert (tmp_path / "first" / "pairs.txt").read_text().splitlines()[0] == "day/1.png day/3.png"


def test_hloc_reads_keypoints_and_matches(views: list[MatchResult], tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    found = collect(views)
    hloc.write(found, tmp_path)
    before = [(tmp_path / name).read_bytes() for name in hloc.FILES]
    hloc.write(found, tmp_path)
    assert [(tmp_path / name).read_bytes() for name in hloc.FILES] == before
    pairs = [line.split() for line in (tmp_path / "pairs.txt").read_text().splitlines()]
    assert pairs == [list(pair.names) for pair in found.pairs]
    with h5py.File(tmp_path / "features.h5") as features, h5py.File(tmp_path / "matches.h5") as matches:
        for pair in found.pairs:  # as hloc.utils.io reads them
            first, second = (features[name]["keypoints"][()] for name in pair.names)
            group = matches["/".join(name.replace("/", "-") for name in pair.names)]
            row = group["matches0"][()]
            (there,) = np.nonzero(row > -1)
            assert len(row) == len(first) == len(there) == 300
            joined = np.hstack([first[there], second[row[there]]]) + 0.5
            ours = np.hstack([found.points[name][pair.rows[:, k]] for k, name in enumerate(pair.names)])
            assert joined == pytest.approx(ours, abs=1e-4)
            assert group["matching_scores0"][()].max() == pytest.approx(0.9, abs=1e-3)


def test_hloc_has_one_match_for_a_keypoint_the_best(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    for name in ("a.png", "b.png"):
        (tmp_path / name).touch()
    points = PointMatches(np.ones((2, 2)), np.array([[1, 1], [2, 2.0]]), np.array([0.3, 0.8]))
    hloc.write(collect([result(tmp_path / "a.png", tmp_path / "b.png", points)]), tmp_path)
    with h5py.File(tmp_path / "matches.h5") as matches:
        assert matches["a.png/b.png/matches0"][()].tolist() == [1]


def test_names_that_are_one_in_hloc(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    paths = [tmp_path / name for name in ("a/1.png", "a-1.png", "b.png")]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    found = collect(result(path, paths[2], PointMatches.empty()) for path in paths[:2])
    with pytest.raises(InputError, match=r"^a-1\.png and a/1\.png have one name"):
        hloc.write(found, tmp_path)
    assert not [name for name in hloc.FILES if (tmp_path / name).exists()]


def test_what_cannot_be_exported(views: list[MatchResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*results: MatchResult, root: Path | None = None) -> str:
        with pytest.raises(InputError) as error:
            collect(results, root)
        return str(error.value)

    spaced = tmp_path / "a b.png"
    spaced.touch()
    photo = Path(str(views[0].left.path))
    assert "no results" in refused()
    assert "no longer there" in refused(result(tmp_path / "gone.png", photo, PointMatches.empty()))
    assert "both sides" in refused(result(photo, photo, PointMatches.empty()))
    assert "has a space" in refused(result(photo, spaced, PointMatches.empty()))
    assert "--images" in refused(*views, root=tmp_path / "elsewhere")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingDependency, match=r"zpm2\[hloc\]"):
        hloc.write(Keypoints(tmp_path, {}, []), tmp_path)


def test_no_common_point(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    pycolmap = pytest.importorskip("pycolmap")
    paths = [tmp_path / f"{name}.png" for name in "ab"]
    for path in paths:
        cv2.imwrite(str(path), np.zeros((8, 8, 3), np.uint8))
    found = collect([result(paths[0], paths[1], PointMatches.empty())])
    hloc.write(found, tmp_path)
    colmap.write(found, tmp_path, seed=0)
    database = pycolmap.Database.open(str(tmp_path / "database.db"))
    assert (database.num_images(), database.num_matches()) == (2, 0)
    database.close()


def test_the_command(views: list[MatchResult], tmp_path: Path, run: Any) -> None:
    pytest.importorskip("h5py")
    for k, each in enumerate(views[:3]):
        folder = tmp_path / "results" / str(k)
        folder.mkdir(parents=True)
        (folder / "matches.json").write_text(json.dumps(each.to_dict()))
    code, out, err = run("export", tmp_path / "results", "--to", "hloc", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "4 photographs with 1200 keypoints" in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*hloc.FILES, ".zpm2"}
    (tmp_path / "results" / "1" / "matches.json").write_text(json.dumps({"schema": "other"}))
    code, _, err = run("export", tmp_path / "results", "--to", "hloc", "-o", tmp_path / "out", "-q")
    assert code == 0
    assert err.startswith("warning: left out: ")
    code, _, err = run("export", tmp_path / "results" / "1", "--to", "hloc", "-o", tmp_path / "other")
    assert (code, len(err.splitlines())) == (2, 1)
    code, _, err = run("export", tmp_path / "photos", "--to", "hloc", "-o", tmp_path / "other")
    assert (code, len(err.splitlines())) == (2, 1)
    assert not (tmp_path / "other").exists()
