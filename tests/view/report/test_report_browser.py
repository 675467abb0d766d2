"""The report in a browser, used as a person would."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import CHROMIUM, Browser
from made import made
from test_report_page import MARKUP

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

ROWS = "[...document.querySelectorAll('#table-body .item')]"
CATCH = """(() => { const real = URL.createObjectURL; window.offered = [];
  URL.createObjectURL = (blob) => { window.offered.push(blob); return real(blob); };
  HTMLAnchorElement.prototype.click = function () { window.named = this.download; }; })()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(made(label="roof").report(), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def browser(shared: Browser, page: Path) -> Iterator[Browser]:
    shared.errors.clear()
    shared.open(page)
    yield shared
    assert shared.errors == []


def spot(browser: Browser, side: str, x: float, y: float) -> tuple[float, float]:
    """Where a pixel of a photograph is on the screen while the photograph is shown whole."""
    left, top, width, height = browser.run(
        f"(() => {{ const b = document.getElementById('panel-{side}').getBoundingClientRect();"
        "return [b.left, b.top, b.width, b.height]; })()"
    )
    zoom = min(width / 320, height / 200) * 0.96
    return left + (width - zoom * 320) / 2 + zoom * x, top + (height - zoom * 200) / 2 + zoom * y


def title(browser: Browser) -> str:
    return str(browser.run("document.querySelector('#detail h2')?.textContent ?? ''"))


def choose(browser: Browser, name: str, value: str) -> None:
    browser.run(
        f"(() => {{ const e = document.querySelector('[data-state={name}]'); e.value = {json.dumps(value)};"
        "e.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )


def painted(browser: Browser, side: str, layer: str, x: float, y: float) -> list[int]:
    """The colour of a canvas at a pixel of its photograph."""
    screen = spot(browser, side, x, y)
    return list(
        browser.run(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {"
            f"const c = document.querySelector('#panel-{side} .{layer}'), b = c.getBoundingClientRect();"
            f"done([...c.getContext('2d').getImageData({screen[0]} - b.left, {screen[1]} - b.top, 1, 1).data]); }})))"
        )
    )


def test_pointing_at_a_polygon_shows_its_partner(browser: Browser) -> None:
    assert title(browser) == ""
    browser.move(*spot(browser, "left", 66, 20))  # the second square
    assert title(browser) == "Match 1roof"
    text = browser.run("document.querySelector('#detail').textContent")
    assert "Right 1001" in text
    assert "local" in text
    assert painted(browser, "right", "top", 66 - 12, 14)[3] > 0  # its partner is lit
    assert painted(browser, "right", "top", 106 - 12, 14)[3] == 0  # others are not
    browser.move(*spot(browser, "left", 26, 20))
    assert title(browser) == "Left polygon 0, not matchedroof"
    assert "Less than half of its expected place" in browser.run("document.querySelector('#detail .why').textContent")
    browser.move(*spot(browser, "left", 2, 100))
    assert title(browser) == ""


def test_the_epipolar_line_of_the_cursor(browser: Browser) -> None:
    browser.move(*spot(browser, "left", 100, 100))
    yellow = painted(browser, "right", "top", 250, 100)
    assert yellow[:2] > [200, 180]
    assert painted(browser, "right", "top", 250, 120)[3] == 0
    browser.press("e")
    assert painted(browser, "right", "top", 250, 100)[3] == 0


def test_a_choice_is_in_the_address_and_comes_back(browser: Browser, page: Path) -> None:
    browser.click(*spot(browser, "right", 66 - 12, 20))
    assert browser.run("location.hash") == "#select=m1"
    browser.move(2, 2)
    assert title(browser) == "Match 1roof"
    choose(browser, "color", "confidence")
    fragment = browser.run("location.hash")
    browser.open(page, fragment)
    assert title(browser) == "Match 1roof"
    assert browser.run("document.querySelector('[data-state=color]').value") == "confidence"
    browser.run("location.hash = '#select=m2'")
    browser.wait("document.querySelector('#detail h2')?.textContent === 'Match 2roof'")


def test_filters_change_table_and_photographs(browser: Browser) -> None:
    listed = "document.getElementById('listed').textContent"
    assert browser.run(listed) == "41 of 41 shown"
    assert painted(browser, "left", "shapes", 66, 12)[3] > 0
    choose(browser, "show", "unmatched")
    assert browser.run(listed) == "9 of 41 shown"
    assert painted(browser, "left", "shapes", 66, 12)[3] == 0
    browser.move(*spot(browser, "left", 66, 20))
    assert title(browser) == ""  # what is not shown cannot be pointed at
    choose(browser, "show", "matched")
    choose(browser, "min", "0.9")
    kept = int(browser.run(listed).split()[0])
    assert kept == sum(match.confidence >= 0.9 for match in made().matches)
    browser.run("document.querySelector('#chosen input[value=global]').click()")
    assert int(browser.run(listed).split()[0]) == sum(
        match.confidence >= 0.9 and match.stage != "global" for match in made().matches
    )
    choose(browser, "text", "nothing like it")
    assert browser.run(listed) == "0 of 41 shown"
    browser.run("document.querySelector('#filters [type=reset]').click()")
    assert browser.run(listed) == "41 of 41 shown"
    assert browser.run("location.hash") == ""


def test_the_table_sorts_and_chooses(browser: Browser) -> None:
    header = "document.querySelector('#table-head .c-confidence button').click()"
    values = f"{ROWS}.map((row) => row.querySelector('.c-confidence').textContent).filter((text) => text !== '–')"
    browser.run(header)
    assert browser.run(values) == sorted(browser.run(values))
    browser.run(header)
    assert browser.run(values) == sorted(browser.run(values), reverse=True)
    key = browser.run(f"{ROWS}[2].dataset.key")
    browser.run(f"{ROWS}[2].click()")
    assert browser.run("location.hash").endswith(f"select={key}") or f"select={key}&" in browser.run("location.hash")
    assert browser.run(f"{ROWS}[2].getAttribute('aria-selected')") == "true"


def test_keys(browser: Browser) -> None:
    for key, expected in (("j", 1), ("ArrowDown", 2), ("j", 3), ("k", 2), ("ArrowUp", 1)):
        browser.press(key)
        assert title(browser) == f"Match {expected}roof"
    browser.press("y")
    assert "1 judged" in browser.run("document.getElementById('listed').textContent")
    browser.press("y")
    assert "judged" not in browser.run("document.getElementById('listed').textContent")
    browser.press("Enter", "\r")
    assert painted(browser, "left", "photo", 5, 5) != [0, 0, 0, 0]
    browser.press("0")
    browser.press("Escape")
    assert title(browser) == ""
    browser.press("/")
    assert browser.run("document.activeElement.dataset.state") == "text"
    browser.type("1003")
    assert browser.run("document.getElementById('listed').textContent").startswith("1 of 41")
    browser.press("j")  # a letter of the search, no command
    assert title(browser) == ""
    browser.press("Escape")
    browser.press("?")
    assert browser.run("document.getElementById('help').open")
    browser.press("Escape")
    browser.wait("!document.getElementById('help').open")
    browser.press("d")
    first = browser.run("getComputedStyle(document.body).backgroundColor")
    browser.press("d")
    assert browser.run("getComputedStyle(document.body).backgroundColor") != first


def test_curtain_and_blink(browser: Browser) -> None:
    browser.press("2")
    assert browser.run("document.getElementById('panel-right').hidden")
    before = painted(browser, "left", "photo", 250, 194)  # no polygon there; the squares of both sides agree anyhow
    middle, y = spot(browser, "left", 160, 100)
    browser.drag((middle, y), (middle + 300, y))
    assert before[3] == 255
    browser.press("ArrowLeft")
    choose(browser, "align", "homography")
    assert "no plane" in browser.run("document.getElementById('no-compare').textContent")
    choose(browser, "align", "points")
    browser.press("3")
    shown = [painted(browser, "left", "photo", 5, 100)]  # beyond what the right photograph shows
    browser.press(" ")
    shown.append(painted(browser, "left", "photo", 5, 100))
    browser.press(" ")
    shown.append(painted(browser, "left", "photo", 5, 100))
    assert [51, 51, 51, 255] in shown
    assert shown[1] != shown[2]
    browser.press("1")
    assert not browser.run("document.getElementById('panel-right').hidden")


def test_wheel_and_drag_move_both_photographs(browser: Browser) -> None:
    before = painted(browser, "right", "photo", 100, 100)
    browser.press("i")
    browser.wheel(*spot(browser, "left", 20, 20), -600)
    after = painted(browser, "right", "photo", 100, 100)
    assert after != pytest.approx(before, abs=2)
    browser.run("document.getElementById('fit').click()")
    browser.press("i")
    assert painted(browser, "right", "photo", 100, 100) == pytest.approx(before, abs=2)


def test_downloads_and_verdicts(browser: Browser) -> None:
    browser.run(CATCH)
    browser.press("j")
    browser.press("n")
    offered = "window.offered.at(-1).text()"
    for what, name in (("result", "matches.json"), ("table", "matches.csv"), ("verdicts", "verdicts.json")):
        browser.run("window.named = ''")
        browser.run(f"document.querySelector('[data-offer={what}]').click()")
        browser.wait(f"window.named === '{name}'")
        text = browser.run(offered)
        if what == "result":
            assert text == json.dumps(made(label="roof").to_dict())
        elif what == "table":
            assert len(text.splitlines()) == 42
            assert text.splitlines()[1].endswith(",wrong")
        else:
            assert json.loads(text)["verdicts"] == [{"match": 1, "left": 1, "right": 1001, "verdict": "wrong"}]


def test_the_tab_of_the_run(browser: Browser) -> None:
    browser.run("document.getElementById('alert').click()")
    text = browser.run("document.getElementById('run').innerText")
    for part in ("a warning", "a note", "probability 0.88", "the scene is no plane", "Timings: 1.0 s", "min_area"):
        assert part in text


def test_markup_is_shown_as_text(browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "a <b> & 'c'.html"
    file.write_text(made(label=MARKUP, path=f"/nowhere/{MARKUP}.png").report(), encoding="utf-8")
    browser.open(file)
    browser.press("j")
    assert title(browser) == f"Match 1{MARKUP}"
    assert "pwned" in browser.run("document.title")  # as a part of the name
    assert browser.run("document.title").endswith("32 matches")
    assert browser.run("document.querySelectorAll('body img:not(.source), [onerror]').length") == 0


def test_large_photographs_are_sharp_where_their_files_are(shared: Browser, tmp_path: Path) -> None:
    result = made(columns=8, rows=5, cell=330)
    folder = result.save(tmp_path / "large", report=True)
    shared.errors.clear()
    shared.open(folder / "report.html", "#select=m1")
    shared.press("Enter", "\r")
    shared.wait("document.documentElement.dataset.tiles === 'shown'")
    assert shared.run("document.getElementById('no-tiles').hidden")
    assert shared.errors == []
    shutil.rmtree(folder / "report_files")
    shared.open(folder / "report.html", "#select=m1")
    shared.press("Enter", "\r")
    shared.wait("!document.getElementById('no-tiles').hidden")
    assert "report_files/ is not beside" in shared.run("document.getElementById('no-tiles').textContent")


def test_a_narrow_screen(browser: Browser, page: Path, tmp_path: Path) -> None:
    browser.resize(600, 900)
    browser.open(page)
    assert browser.run("document.documentElement.scrollWidth") <= 600
    (tmp_path / "report.html").write_text(made(label="long" * 100).report(), encoding="utf-8")
    browser.open(tmp_path / "report.html", "#select=m1")
    assert browser.run("document.documentElement.scrollWidth") <= 600
    browser.resize(1280, 800)


def test_the_page_says_what_the_photographs_are_aligned_by(browser: Browser) -> None:
    browser.press("2")
    said = "document.getElementById('compared').textContent"
    assert not browser.run("document.getElementById('compared').hidden")
    assert "Aligned by homologous points" in browser.run(said)
    choose(browser, "align", "epipolar")
    assert "Rectified" in browser.run(said)
    assert "80 % of the points are within 0.0 px" in browser.run(said)
    assert painted(browser, "left", "photo", 160, 100)[3] == 255
    choose(browser, "align", "homography")
    assert browser.run("document.getElementById('compared').hidden")
    assert "by homography: the scene is no plane" in browser.run("document.getElementById('no-compare').textContent")
    browser.press("1")
    assert browser.run("document.getElementById('no-compare').hidden")
