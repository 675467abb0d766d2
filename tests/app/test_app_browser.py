"""The page in a browser, used as a person would: from two dropped photographs to the exported files."""

import base64
import io
import json
import signal
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from browser import CHROMIUM, Browser
from squares import PLACES, SHIFT, SIDE, save, square
from test_app_command import started

from zpm2 import MatchResult

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

MARKUP = "<img src=x onerror=document.title='pwned'>\"'.png"
DROP = """async (side, name, packed) => {
  const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
  const data = new DataTransfer();
  data.items.add(new File([bytes], name, {type: "image/png"}));
  document.getElementById("slot-" + side).dispatchEvent(new DragEvent("drop", {dataTransfer: data, bubbles: true}));
}"""
CATCH = """(() => { window.offered = []; const real = URL.createObjectURL;
  URL.createObjectURL = (blob) => { window.offered.push(blob); return real(blob); };
  HTMLAnchorElement.prototype.click = () => {}; })()"""
OFFERED = """(async () => { const bytes = new Uint8Array(await window.offered.at(-1).arrayBuffer());
  return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join("")); })()"""
QUIET = "document.documentElement.dataset.prepared && window.app.asking === 0"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("app")


@pytest.fixture(scope="module")
def browser(place: Path) -> Iterator[Browser]:
    """At the page, with both photographs dropped."""
    (place / "scratch").mkdir()
    done, address = started(place / "scratch")
    with Browser(place / "profile") as found:
        found.call("Page.navigate", url=address)
        found.wait("document.getElementById('start')?.hidden === false")
        for side, file in zip(("left", "right"), save(place), strict=True):
            packed = base64.b64encode(file.read_bytes()).decode()
            found.run(f"({DROP})({side!r}, {json.dumps(MARKUP)}, {packed!r})")
            found.wait(f"document.querySelector('#slot-{side} img')?.naturalWidth > 0")
        found.wait("document.documentElement.dataset.ready")
        found.wait(QUIET)
        yield found
        # a prompt that a newer one replaced before it had begun is answered 409, whose status Chromium logs
        assert [each for each in found.errors if "409 (Conflict)" not in each] == []
    done.send_signal(signal.SIGTERM)
    _, err = done.communicate(timeout=60)
    assert (done.returncode, err) == (0, "Ctrl-C ends it.\n")
    assert list((place / "scratch").iterdir()) == []


def spot(browser: Browser, side: int, x: float, y: float) -> tuple[float, float]:
    """Where a pixel of a photograph is on the screen."""
    left, top, zoom, dx, dy = browser.run(
        f"(() => {{ const p = window.app.panels[{side}], b = p.element.getBoundingClientRect();"
        "return [b.left, b.top, p.view.zoom, p.view.x, p.view.y]; })()"
    )
    return left + dx + zoom * x, top + dy + zoom * y


def middle(browser: Browser, number: int, side: int = 0) -> tuple[float, float]:
    x, y = PLACES[number]
    return spot(browser, side, x - SHIFT * side + SIDE / 2, y + SIDE / 2)


def overlap(browser: Browser, side: int, number: int) -> float:
    """IoU of the selected region with a square."""
    parts = browser.run(f"window.app.selected.shapes[{side}]")
    shape = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in parts or []])
    true = shapely.Polygon(square(number, side)[0][0])
    return float(shape.intersection(true).area / shape.union(true).area)


def text(browser: Browser, selector: str) -> str:
    return str(browser.run(f"document.querySelector({selector!r}).textContent"))


def test_from_dropped_photographs_to_files(browser: Browser, place: Path) -> None:
    assert text(browser, "#names") == f"{MARKUP}and{MARKUP}"
    assert "token" not in browser.run("location.href")

    browser.click(*middle(browser, 0))  # a point on the left
    browser.wait(QUIET)
    assert min(overlap(browser, 0, 0), overlap(browser, 1, 0)) > 0.85
    assert "found" in text(browser, "#detail .why")
    browser.press("Enter", "\r")
    assert text(browser, "#counts") == "1 region, 1 accepted"

    browser.press("2")  # a box on the right
    x, y = PLACES[1]
    browser.drag(spot(browser, 1, x - SHIFT + 2, y + 2), spot(browser, 1, x - SHIFT + SIDE, y + SIDE))
    browser.wait(QUIET)
    assert min(overlap(browser, 0, 1), overlap(browser, 1, 1)) > 0.85
    browser.run("document.querySelector('.label-field').value = '<b>roof</b>'")
    browser.run("document.querySelector('.label-field').dispatchEvent(new Event('change'))")
    assert text(browser, "#regions [aria-pressed=true] .what") == "<b>roof</b>"
    browser.press("Enter", "\r")

    browser.press("3")  # an outline on the left, closed at its first corner
    for corner in (*square(2)[0][0], square(2)[0][0][0]):
        browser.click(*spot(browser, 0, *corner))
    browser.wait(QUIET)
    assert overlap(browser, 0, 2) > 0.98
    assert overlap(browser, 1, 2) > 0.85

    browser.press("4")  # a corner on the right is moved: the left side stays
    before = browser.run("JSON.stringify(window.app.selected.shapes[0])")
    corner = browser.run("window.app.selected.shapes[1][0][0][0]")
    browser.drag(spot(browser, 1, *corner), spot(browser, 1, corner[0] - 15, corner[1] - 10))
    moved = browser.run("window.app.selected.shapes[1][0][0][0]")
    assert np.allclose(moved, (corner[0] - 15, corner[1] - 10), atol=1)
    assert browser.run("JSON.stringify(window.app.selected.shapes[0])") == before
    browser.wait(QUIET)
    assert "corrected" in text(browser, "#detail .why")
    browser.press("u")
    assert np.allclose(browser.run("window.app.selected.shapes[1][0][0][0]"), corner)
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="z", modifiers=10)  # Ctrl and Shift
    assert np.allclose(browser.run("window.app.selected.shapes[1][0][0][0]"), moved)
    browser.press("Enter", "\r")

    browser.press("1")  # a region that the person rejects, and a point that takes away
    browser.click(*middle(browser, 3))
    browser.click(*spot(browser, 0, 10, 10), button="right")
    browser.wait(QUIET)
    assert browser.run("window.app.selected.prompts[0].points.map((point) => point[2])") == [1, 0]
    browser.press("Delete")
    assert browser.run("document.querySelectorAll('#regions .rejected').length") == 1

    browser.run(CATCH)
    browser.run("document.querySelector('#exports').open = true")
    browser.run("document.querySelector('#formats input[value=coco]').click()")
    browser.run("document.getElementById('export').click()")
    browser.wait("document.getElementById('export-note').textContent.includes('zpm2-app.zip')")
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(browser.run(OFFERED)))) as file:
        file.extractall(place)
    result = MatchResult.load(place / "zpm2-app")
    assert len(result.matches) == 3
    assert [polygon.label for polygon in result.right.polygons] == [None, "<b>roof</b>", None]
    assert (place / "zpm2-app" / "left.coco.json").exists()
    assert browser.run("document.title") == "zpm2 app"


def test_loading_the_page_again_keeps_the_regions(browser: Browser) -> None:
    browser.run("new Promise((done) => setTimeout(done, 600))")
    browser.run("window.before = true")
    browser.call("Page.reload")
    browser.wait("!window.before && document.documentElement?.dataset.prepared && window.app?.asking === 0")
    assert text(browser, "#counts") == "4 regions, 3 accepted"


def test_errors_are_shown_on_the_page(browser: Browser) -> None:
    browser.run("window.app.pair = 99")
    browser.press("1")
    browser.click(*middle(browser, 3))
    browser.wait("window.app.asking === 0")
    assert "the photographs have changed" in text(browser, "#detail .warnings")
    browser.errors[:] = [each for each in browser.errors if "400 (Bad Request)" not in each]  # Chromium logs the status
