"""The picture from three viewpoints, and the page in a browser."""

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, WEBGL, Browser
from clouds import cloud_of, looking_down, squares
from meshes import grid, sphere

from zpm2.cloud import PolygonCloud
from zpm2.cloud.display_mesh import clustered, display_mesh
from zpm2.cloud.export import BOUNDARY_SHADE
from zpm2.cloud.page import page
from zpm2.cloud.picture import GAP, SIZE, three_views
from zpm2.errors import Failed


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> PolygonCloud:
    cameras = [looking_down(-0.4, 0.1, 2.5), looking_down(0.4, -0.1, 2.5)]
    return cloud_of(grid(12, seed=1), squares(), cameras, tmp_path_factory.mktemp("cloud"))


def test_three_views_show_every_polygon_and_its_boundary(cloud: PolygonCloud) -> None:
    pytest.importorskip("embreex")
    picture = three_views(display_mesh(cloud))
    assert not isinstance(picture, Failed)
    assert picture.shape == (SIZE[1], 3 * SIZE[0] + 2 * GAP, 3)
    middle = picture[:, SIZE[0] + GAP : 2 * SIZE[0] + GAP].astype(float)
    for rgb in cloud.colors.astype(float):
        light = middle @ rgb / (rgb @ rgb)  # the same colour at some brightness
        like = np.abs(middle - light[..., None] * rgb).max(2) < 6
        assert (like & (light > 0.5) & (light < 1.05)).sum() > 300
        assert (like & (np.abs(light - BOUNDARY_SHADE) < 0.06)).sum() > 20
    # nothing is cut off
    for edge in (middle[0], middle[-1], middle[:, 0], middle[:, -1]):
        assert (edge.min(1) > 150).all()


def test_without_embree_there_is_no_picture_but_a_reason(cloud: PolygonCloud, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zpm2.cloud.rays.find_spec", lambda name: None)
    picture = three_views(display_mesh(cloud))
    assert isinstance(picture, Failed)
    assert "pip install" in picture.reason


def test_fewer_triangles_of_the_same_shape() -> None:
    ball = sphere(5)
    vertices, faces = clustered(ball.vertices, ball.faces, 3000)
    assert 500 < len(faces) < 6000 < len(ball.faces)
    assert np.linalg.norm(vertices + ball.origin, axis=1) == pytest.approx(1, abs=0.02)
    assert clustered(ball.vertices, ball.faces, 10**6)[1] is ball.faces


def test_the_page_needs_nothing_else(cloud: PolygonCloud) -> None:
    text = page(cloud)
    assert not re.findall(r"(?:src|href)=|https?://|@import|fetch\(", text)
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])
    assert len(data["polygons"]) == 9
    assert "9 polygons from 9 matches in 2 views" in data["about"]
    for polygon, patch in zip(data["polygons"], cloud.patches, strict=True):
        (match,) = polygon["matches"]
        assert match == {"match": patch.supports[0].left_polygon, "left_view": 0, "right_view": 1}


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    with Browser(tmp_path_factory.mktemp("profile"), 1200, 700, WEBGL) as found:
        yield found


@pytest.fixture
def browser(shared: Browser) -> Iterator[Browser]:
    shared.errors.clear()
    yield shared
    assert shared.errors == []


def test_the_page_in_a_browser(browser: Browser, cloud: PolygonCloud, tmp_path: Path) -> None:
    """It draws, and pointing at the middle names the polygon there; beside all polygons it names none."""
    middle = np.argmin([np.linalg.norm(p.patch.centroid[:2]) for p in cloud.patches])
    for place, expected in (("0.5,0.5", int(middle)), ("0.02,0.5", -1)):
        dom = opened(browser, cloud, tmp_path, f"#pick={place}")
        assert f'data-picked="{expected}"' in dom
        assert (f"Polygon {expected}" in dom) == (expected >= 0)


def opened(browser: Browser, cloud: PolygonCloud, folder: Path, fragment: str = "") -> str:
    """What a browser makes of the page."""
    file = folder / "cloud.html"
    file.write_text(page(cloud), encoding="utf-8")
    browser.open(file, fragment)
    dom = str(browser.run("document.documentElement.outerHTML"))
    assert 'data-ready="yes"' in dom
    return dom


def test_the_page_as_a_person_uses_it(browser: Browser, cloud: PolygonCloud, tmp_path: Path) -> None:
    opened(browser, cloud, tmp_path)
    x, y = browser.run(
        "(() => { const b = document.getElementById('view').getBoundingClientRect();"
        "return [b.left + b.width / 2, b.top + b.height / 2]; })()"
    )
    picked = "Number(document.body.dataset.picked)"
    browser.move(x, y)
    middle = browser.run(picked)
    assert middle >= 0
    browser.click(x, y)
    assert browser.run("location.hash") == f"#select=p{middle}"
    browser.move(2, 2)
    assert browser.run(picked) == middle  # chosen
    browser.press("Escape")
    assert browser.run(picked) == -1
    browser.press("/")
    browser.type(str((middle + 1) % 9))
    assert browser.run("document.getElementById('listed').textContent") == "1 of 9 polygons shown"
    browser.move(x, y)
    assert browser.run(picked) == -1  # those that the filters leave out are not drawn
    browser.press("Escape")
    browser.press("j")
    browser.press("Enter", "\r")  # turns around the only one, which is in the middle then
    browser.run("new Promise((done) => requestAnimationFrame(done))")
    browser.press("Escape")
    browser.move(x + 1, y)
    assert browser.run(picked) == (middle + 1) % 9
    browser.drag((x, y), (x + 300, y + 120))
    browser.wheel(x, y, 300)
    browser.press("c")
    assert "color=confidence" in browser.run("location.hash")


MARKUP = "</script><!--<script><img src=x onerror=document.title='pwned'>\u2028\u2029]]>&lt;'\"`${1}"


def test_names_and_labels_full_of_markup_stay_text(cloud: PolygonCloud) -> None:
    text = page(marked(cloud))
    inside = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1]
    assert "<" not in inside
    assert inside.isascii()
    data = json.loads(inside)
    assert data["views"] == [f"{MARKUP}{k}.png" for k in range(2)]
    assert {polygon["label"] for polygon in data["polygons"]} == {MARKUP}


def test_markup_is_shown_as_text_in_a_browser(browser: Browser, cloud: PolygonCloud, tmp_path: Path) -> None:
    dom = opened(browser, marked(cloud), tmp_path, "#pick=0.5,0.5")
    assert "pwned" not in re.search(r"<title>(.*?)</title>", dom, re.S)[1]
    assert "<img" not in re.sub(r"<script.*?</script>", "", dom, flags=re.S)
    assert dom.count("&lt;img src=x onerror=") >= 2  # in the title of the polygon, and where it was seen


def marked(cloud: PolygonCloud) -> PolygonCloud:
    """The cloud with labels and file names that a page could take for its own."""
    views = [dataclasses.replace(view, name=f"{MARKUP}{k}.png") for k, view in enumerate(cloud.views)]
    patches = [
        dataclasses.replace(patch, polygon=dataclasses.replace(patch.polygon, label=MARKUP)) for patch in cloud.patches
    ]
    return dataclasses.replace(cloud, views=views, patches=patches)
