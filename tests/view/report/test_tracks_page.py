"""The report of tracks: its text, and its use in a browser."""

import base64
import dataclasses
import gzip
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from browser import CHROMIUM, Browser
from made import noise, square
from test_report_page import MARKUP

from zpm2.config import preset
from zpm2.tracking.photographs import Photograph
from zpm2.tracking.result import DOCUMENT, PairSummary, RegionTrack, SeenRegion, TracksResult
from zpm2.view.report import tracks as tracks_page

SIZE = (240, 160)
STRIPS = "[...document.querySelectorAll('.strip')]"


def made(folder: Path, name: str = "photo") -> TracksResult:
    """Four photographs of noise, nine tracks; the k-th is in 2 + k % 3 photographs, every fourth was carried there."""
    photographs = []
    for k in range(4):
        path = folder / f"{k}.png"
        PIL.Image.fromarray(noise(k, *SIZE).rgb).save(path)
        photographs.append(Photograph(f"{name} {k}", str(path), *SIZE))
    tracks = []
    for k in range(9):
        x, y = 10 + 70 * (k % 3), 8 + 50 * (k // 3)
        seen = {
            row: SeenRegion(square(k + 1, x + 5 * row, y), 0.5 + 0.05 * k, k % 4 == 0 and row > 0)
            for row in range(2 + k % 3)
        }
        tracks.append(RegionTrack(k + 1, seen, {3: "hidden"} if k == 1 else {}, k))
    config = dataclasses.asdict(preset("default"))
    return TracksResult(photographs, tracks, [], [PairSummary(0, 1, 9, 0, 0)], "sequential", config, {"match": 1.5})


def data_of(page: str) -> Any:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def test_the_page_holds_all_and_needs_nothing(tmp_path: Path) -> None:
    result = made(tmp_path)
    out = result.save(tmp_path / "out", 0, report=True)
    page = (out / "report.html").read_text("utf-8")
    plain = re.sub(r"data:[\w/+-]+;base64,[\w+/=]+", "", page)
    assert not re.findall(r'(?:src|href)="[^"]|https?://|@import|fetch\(', plain)
    assert "default-src 'none'" in page
    data = data_of(page)
    assert [photograph["name"] for photograph in data["photographs"]] == [f"photo {k}" for k in range(4)]
    assert [len(track["seen"]) for track in data["tracks"]] == [2, 3, 4] * 3
    assert data["tracks"][1]["absent"] == [[3, "hidden"]]
    first = data["tracks"][0]["seen"][1]
    vertices = np.cumsum(np.reshape(first["rings"][0], (-1, 2)), axis=0) / data["steps"]
    assert np.abs(vertices - result.tracks[0].seen[1].polygon.exterior).max() < 0.1
    packed = re.search(r'id="document">data:application/gzip;base64,(.*?)</script>', page)
    assert json.loads(gzip.decompress(base64.b64decode(packed[1]))) == json.loads((out / DOCUMENT).read_text())
    assert result.save(tmp_path / "again", 0, report=True).joinpath("report.html").read_text("utf-8") == page
    result.save(out, 0)  # a result without a page takes the old one away
    assert not (out / "report.html").exists()


def test_names_stay_text(tmp_path: Path) -> None:
    result = made(tmp_path, MARKUP)
    page = tracks_page.page(result.photographs, result.tracks, result.to_dict(), {}, preset("default").raster)
    assert data_of(page)["photographs"][0]["name"] == f"{MARKUP} 0"
    assert page.count("<script") == page.count("</script>") == 5


def test_many_photographs_are_reduced_further() -> None:
    def longest(count: int) -> int:
        return tracks_page._longest([Photograph("", "", 4000, 3000)] * count)

    assert longest(2) == tracks_page.LONGEST
    assert longest(200) ** 2 * 0.75 * 200 <= tracks_page.AREA < (longest(200) + 1) ** 2 * 0.75 * 200


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tracks")
    return made(folder).save(folder / "out", 0, report=True) / "report.html"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def browser(shared: Browser, page: Path) -> Iterator[Browser]:
    shared.errors.clear()
    shared.open(page)
    yield shared
    assert shared.errors == []


def ids(browser: Browser) -> list[int]:
    return [int(key[1:]) for key in browser.run(f"{STRIPS}.map((each) => each.dataset.key)")]


def listed(browser: Browser) -> str:
    return str(browser.run("document.getElementById('listed').textContent"))


def lit(browser: Browser) -> list[bool]:
    """Which photographs show an outline on top."""
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return list(
        browser.run(
            "[...document.querySelectorAll('canvas.top')].map((c) => c.getContext('2d')"
            ".getImageData(0, 0, c.width, c.height).data.some((value) => value > 0))"
        )
    )


def choose(browser: Browser, name: str, value: object) -> None:
    browser.run(
        f"(() => {{ const e = document.querySelector('[data-state={name}]'); e.value = {json.dumps(value)};"
        "e.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )


def test_pointing_at_a_strip_lights_the_track_everywhere(browser: Browser) -> None:
    assert ids(browser)[:3] == [3, 6, 9]  # those in most photographs
    assert browser.run(f"{STRIPS}[0].querySelectorAll('canvas').length") == 4
    place = f"(() => {{ const b = {STRIPS}[0].getBoundingClientRect(); return [b.left + 9, b.top + 9]; }})()"
    browser.move(*browser.run(place))
    assert lit(browser) == [True] * 4
    browser.move(1, 1)
    assert lit(browser) == [False] * 4


def test_pointing_at_a_photograph_lights_the_strip(browser: Browser) -> None:
    x, y, zoom = browser.run(
        "(() => { const b = document.querySelectorAll('#photographs .panel')[1].getBoundingClientRect();"
        "return [b.left + 0.02 * b.width, b.top + 0.02 * b.height, 0.96 * b.width / 240]; })()"
    )
    browser.move(x + zoom * (10 + 5 + 12), y + zoom * (8 + 12))  # track 1 in the second photograph
    assert lit(browser) == [True, True, False, False]
    assert browser.run(f"{STRIPS}.find((each) => each.dataset.key === 't1').classList.contains('hovered')")
    assert browser.run("document.querySelectorAll('.panel.without').length") == 2


def test_filters_and_order(browser: Browser, page: Path) -> None:
    choose(browser, "photographs", 3)
    assert listed(browser) == "6 of 9 tracks shown"
    choose(browser, "min", 0.7)
    choose(browser, "sort", "weakest")
    assert ids(browser) == [5, 6, 8, 9]
    browser.run("document.querySelector('[data-state=carried]').click()")
    assert ids(browser) == [5, 9]
    browser.open(page, browser.run("location.hash"))  # the address holds it
    assert ids(browser) == [5, 9]
    browser.run("document.querySelector('#filters [type=reset]').click()")
    choose(browser, "text", "photo 3")
    assert listed(browser) == "3 of 9 tracks shown"


def test_a_narrow_screen_has_one_column(browser: Browser) -> None:
    browser.resize(600, 900)
    assert browser.run("getComputedStyle(document.querySelector('main')).gridTemplateColumns") == "600px"
    assert browser.run("document.documentElement.scrollWidth") <= 600
    browser.resize(1280, 800)


def test_keys(browser: Browser) -> None:
    browser.press("j")
    assert browser.run("document.querySelector('.strip[aria-selected=true]').dataset.key") == "t3"
    browser.press("Enter", "\r")
    assert lit(browser) == [True] * 4
    browser.press("c")
    assert browser.run("location.hash") == "#select=t3&color=confidence"
    browser.press("Escape")
    assert browser.run("document.querySelector('.strip[aria-selected=true]')") is None


def test_the_result_can_be_downloaded(browser: Browser, page: Path) -> None:
    catch = "window.offered = []; URL.createObjectURL = (b) => (window.offered.push(b), '#');"
    browser.run(f"(() => {{ {catch} HTMLAnchorElement.prototype.click = function () {{}}; }})()")
    for what in ("result", "table"):
        browser.run(f"document.querySelector('[data-offer={what}]').click()")
    browser.wait("window.offered.length === 2")
    texts = browser.run("Promise.all(window.offered.map((blob) => blob.text()))")
    table, result = sorted(texts, key=len)
    assert json.loads(result) == json.loads((page.parent / DOCUMENT).read_text())
    assert table.splitlines()[1].startswith("3,4,0.6,0,2,photo 0 photo 1")
