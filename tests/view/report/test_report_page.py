"""The text of the report: what it holds, and that nothing in it can act as markup."""

import base64
import dataclasses
import gzip
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import SHIFT, made, noise

from zpm2 import geometry
from zpm2.errors import Failed, InputError
from zpm2.model import PointMatches, Polygon
from zpm2.photos.source import InMemoryPhoto
from zpm2.result import MatchResult, save_report
from zpm2.view.report import alignment, build, content, tiles

MARKUP = "</script><!--<script><img src=x onerror=document.title='pwned'>\u2028]]>&lt;'\"`${1}{{ 7 }}"


def data_of(page: str) -> Any:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def picture_of(page: str, name: str) -> PIL.Image.Image:
    url = re.search(f'id="picture-{name}" alt="" src="data:image/webp;base64,(.*?)"', page)
    return PIL.Image.open(io.BytesIO(base64.b64decode(url[1])))


def test_the_page_holds_all_and_needs_nothing() -> None:
    result = made(label="roof")
    page = result.report()
    plain = re.sub(r"data:[\w/+-]+;base64,[\w+/=]+", "", page)
    assert not re.findall(r'(?:src|href)="[^"]|https?://|@import|fetch\(', plain)
    assert "default-src 'none'" in page
    data = data_of(page)
    assert len(data["matches"]) == len(result.matches) == 32
    first, match = data["matches"][0], result.matches[0]
    assert (first["left"], first["right"], first["dsf"], first["stage"]) == (
        match.left,
        match.right,
        match.dsf,
        match.stage,
    )
    left = data["sides"][0]["polygons"]
    assert left[0]["why"] == "outside overlap"
    assert left[1]["why"] is None
    assert {polygon["label"] for polygon in left} == {"roof"}
    assert data["run"]["warnings"] == ["a warning"]
    timings = re.search(r'id="timings">(.*?)</script>', page)[1]
    assert json.loads(timings) == {"read": 0.25, "local": 0.75}
    assert data["homography"]["failed"] == data["aligned"]["homography"] == "the scene is no plane"
    packed = re.search(r'id="document">data:application/gzip;base64,(.*?)</script>', page)
    text = gzip.decompress(base64.b64decode(packed[1])).decode().replace('"timings": {}', f'"timings": {timings}')
    assert text == json.dumps(result.to_dict())


def test_two_runs_differ_in_their_timings_only() -> None:
    assert made().report() == made().report()
    slower = dataclasses.replace(made(), timings={"read": 17.0}).report()
    assert slower != made().report()
    plain = [re.sub(r'id="timings">.*?<', "", page) for page in (slower, made().report())]
    assert plain[0] == plain[1]


def test_markup_in_names_and_labels_stays_text() -> None:
    page = made(label=MARKUP, path=f"/nowhere/{MARKUP}.png").report()
    inside = re.search(r'id="data">(.*?)</script>', page, re.S)[1]
    assert "<" not in inside
    data = data_of(page)
    assert data["sides"][0]["polygons"][3]["label"] == MARKUP
    rest = page.replace(inside, "")
    assert "onerror" not in re.sub(r"&[\w#]+;", "", rest) or "<img src=x" not in rest
    assert rest.count("<script") == rest.count("</script>") == 5


def test_large_photographs_are_reduced() -> None:
    result = made(columns=12, rows=4, cell=240)
    page = result.report()
    assert picture_of(page, "left").size == picture_of(page, "points").size == (build.LONGEST, round(build.LONGEST / 3))
    data = data_of(page)
    assert data["sides"][0]["width"] == 2880
    ring, scale = data["sides"][0]["polygons"][0]["rings"][0], data["scales"][0]
    vertices = np.cumsum(np.reshape(ring, (-1, 2)), axis=0) / data["steps"] / scale
    assert np.abs(vertices - result.left.polygons[0].exterior).max() < 0.2


def test_outlines_are_simplified_at_the_scale_shown() -> None:
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    circle = np.c_[np.cos(angle), np.sin(angle)]
    polygon = Polygon(0, 100 + 80 * circle, (100 + 20 * circle[::-1], 100 + 0.02 * circle[::-1]))
    rings = content.rings(polygon, np.array([0.5, 0.5]))
    assert len(rings) == 2  # the small hole cannot be seen
    assert 20 < len(rings[0]) / 2 < 100
    vertices = np.cumsum(np.reshape(rings[0], (-1, 2)), axis=0) / content.STEPS / 0.5
    radius = np.linalg.norm(vertices - 100, axis=1)
    assert np.abs(radius - 80).max() < 2 * content.TOLERANCE + 0.2


def test_thin_polygons_keep_their_vertices() -> None:
    sliver = Polygon(0, np.array([[5.0, 5.0], [5.01, 5.0], [5.01, 60.0]]))
    assert len(content.rings(sliver, np.array([0.25, 0.25]))[0]) >= 6


@pytest.mark.parametrize("how", ["points", "homography"])
def test_the_right_photograph_is_laid_over_the_left_one(how: str) -> None:
    result = made(columns=12, rows=8)
    left, right = result.images()
    scale, size = np.ones(2), (left.width, left.height)
    shift = np.array([[1, 0, -SHIFT], [0, 1, 0], [0, 0, 1.0]])
    found = (
        alignment.by_points(right.rgb, result.points, (scale, scale), size)
        if how == "points"
        else alignment.by_homography(right.rgb, shift, (scale, scale), size)
    )
    assert not isinstance(found, Failed)
    seen = found[8:-8, 24:-8]
    assert (seen[..., 3] == 255).all()
    assert np.abs(seen[..., :3].astype(int) - left.rgb[8:-8, 24:-8]).mean() < 1
    assert (found[:, :10, 3] == 0).all()  # left of what the right photograph shows


def test_points_that_move_unlike_their_neighbours_are_left_out() -> None:
    random = np.random.default_rng(0)
    left = random.uniform(0, 400, (200, 2))
    points = PointMatches(left, left - (SHIFT, 0), np.ones(200))
    points.right[::20] += 60
    scale, image = np.ones(2), noise(4, 400, 400)
    found = alignment.by_points(image.rgb, points, (scale, scale), (400, 400))
    assert not isinstance(found, Failed)
    seen, expected = found[50:350, 50:350], image.rgb[50:350, 38:338]
    assert np.abs(seen[..., :3].astype(int) - expected).mean() < 1


def test_without_points_there_is_no_alignment() -> None:
    few = made().points[np.array([0, 1])]
    assert isinstance(alignment.by_points(noise(0, 80, 80).rgb, few, (np.ones(2), np.ones(2)), (80, 80)), Failed)
    none = made().points[np.array([], int)]
    found = alignment.by_points(noise(0, 80, 80).rgb, none, (np.ones(2), np.ones(2)), (80, 80))
    assert str(found) == "there are no homologous points"


def test_a_result_without_matches() -> None:
    result = dataclasses.replace(made(), matches=[], fundamental=Failed("too few points"))
    data = data_of(result.report())
    assert data["matches"] == []
    assert data["fundamental"] == {"matrix": None, "failed": "too few points"}


def test_a_missing_report_is_made_later(tmp_path: Path) -> None:
    result, files = made(), {}
    for name, side in (("left", result.left), ("right", result.right)):
        assert side.image is not None
        files[name] = tmp_path / f"{name}.png"
        PIL.Image.fromarray(side.image.rgb).save(files[name])
    result = dataclasses.replace(
        result,
        left=dataclasses.replace(result.left, path=str(files["left"])),
        right=dataclasses.replace(result.right, path=str(files["right"])),
    )
    with_page, without = result.save(tmp_path / "a", report=True), result.save(tmp_path / "b")
    assert not (without / "report.html").exists()
    page = save_report(without)
    assert page == without / "report.html"
    first, second = (data_of((folder / "report.html").read_text("utf-8")) for folder in (with_page, without))
    assert first == second
    MatchResult.load(without).save(without)  # a result without a page takes the old one away
    assert not page.exists()
    files["left"].unlink()
    with pytest.raises(InputError, match=r"left\.png"):
        save_report(without)


def test_large_photographs_come_at_full_size_beside_the_page(tmp_path: Path) -> None:
    result = made(columns=8, rows=5, cell=330)
    folder = result.save(tmp_path / "large", report=True)
    data = data_of((folder / "report.html").read_text("utf-8"))
    assert data["tiles"] == [{"folder": "report_files", "side": 1024, "levels": 1}] * 2
    assert data["scales"] == [[1, 1], [1, 1]]  # outlines are as sharp as the tiles
    names = sorted(path.name for path in (folder / "report_files").iterdir())
    assert len(names) == 2 * 3 * 2
    with PIL.Image.open(folder / "report_files" / "left-0-2-1.jpg") as tile:
        assert tile.size == (2640 - 2048, 1650 - 1024)
        expected = result.images()[0].rgb[1024:, 2048:].astype(int)
        assert np.abs(np.asarray(tile).astype(int) - expected).mean() < 4
    stale = folder / "report_files" / names[0]
    made().save(folder, report=True)  # smaller photographs: the old tiles go
    assert not stale.parent.exists()
    assert data_of((folder / "report.html").read_text("utf-8"))["tiles"] == [None, None]


def test_levels_of_tiles() -> None:
    assert [tiles.levels(side, 100, 1600) for side in (1600, 1601, 3200, 3201, 12800, 12801)] == [0, 1, 1, 2, 3, 4]
    image = noise(3, 3000, 1100)
    found = dict(tiles.tiles(InMemoryPhoto(image), 2))
    assert sorted(found) == sorted([*(f"0-{i}-{j}.jpg" for i in range(3) for j in range(2)), "1-0-0.jpg", "1-1-0.jpg"])
    assert PIL.Image.open(io.BytesIO(found["1-1-0.jpg"])).size == (476, 550)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rectified_points_stay_on_their_epipolar_lines(seed: int) -> None:
    random = np.random.default_rng(seed)
    world = np.c_[random.uniform(-2, 2, (60, 2)), random.uniform(4, 9, 60)]
    camera = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    turn = np.eye(3) + geometry.cross_matrix(random.normal(0, 0.03, 3))
    move = random.normal(0, 1, 3) * (1, 1, 0.3)
    move *= 0.5 / np.linalg.norm(move)
    left, right = world @ camera.T, (world @ turn.T + move) @ camera.T
    points = PointMatches(left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:], np.ones(60))
    inverse = np.linalg.inv(camera)
    fundamental = inverse.T @ geometry.cross_matrix(move) @ turn @ inverse
    found = alignment.rectifying(fundamental, points)
    assert not isinstance(found, Failed)
    moved = geometry.project(found, points.left)
    assert geometry.epipolar_distance(fundamental, points.left, moved).max() < 1e-3
    away = np.linalg.norm(moved - points.right, axis=1).sum()
    for depth in (4.5, 5.5, 6.5, 8.0):  # no plane parallel to the photographs brings them nearer to their partners
        plane = camera @ (turn + np.outer(move, (0, 0, 1)) / depth) @ inverse
        there = geometry.project(plane, points.left)
        assert away <= 1.02 * np.linalg.norm(there - points.right, axis=1).sum()


def test_the_page_is_rectified_where_that_brings_points_nearer() -> None:
    random = np.random.default_rng(0)
    left = random.uniform(0, 300, (200, 2))
    points = PointMatches(left, left - np.c_[random.uniform(10, 14, 200), np.zeros(200)], np.ones(200))
    sideways = np.array([[0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    rectified = alignment.rectifying(sideways, points)
    assert not isinstance(rectified, Failed)
    assert rectified / rectified[2, 2] == pytest.approx(np.array([[1, 0, -12], [0, 1, 0], [0, 0, 1.0]]), abs=0.5)
    wrong, right = np.eye(3), np.array([[1, 0, -12.0], [0, 1, 0], [0, 0, 1]])
    chosen, other = alignment.better(rectified, wrong, points)
    assert chosen is rectified
    assert "the epipolar lines fit better (80 % of the homologous points lie within" in str(other)
    exact = dataclasses.replace(points, right=left - (12, 0))
    other, chosen = alignment.better(np.eye(3), right, exact)
    assert chosen is right
    assert "the homography fits better" in str(other)
    none = Failed("no F")
    assert alignment.better(none, right, points) == (none, right)
    assert alignment.rectifying(none, points) is none
    assert isinstance(alignment.rectifying(sideways, points[np.arange(2)]), Failed)
    assert alignment.within(right, points[np.arange(0)]) is None
