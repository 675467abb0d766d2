"""The page of an evaluation: the worst pairs first, with links to their reports."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from browser import CHROMIUM, Browser
from rendered import Pair, Run

from zpm2.api import Matcher
from zpm2.config import assign, preset
from zpm2.errors import InputError
from zpm2.evaluate.overview import save_overview
from zpm2.evaluate.report import write
from zpm2.segment.given.precomputed import PrecomputedSegmenter

ROWS = "pair,status,F1,P,R,good,scored,seconds\ngood,ok,0.9,0.9,0.9,9,10,1\nbad <b>,ok,0.25,0.5,0.2,2,8,1\n"


@pytest.fixture(scope="module")
def evaluation(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three results and a failure, two of them scored, as `zpm2 eval` lays them out."""
    out = tmp_path_factory.mktemp("overview") / "an evaluation"
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    chosen = assign(preset("default"), ["points.methods=sift", "device=cpu"])
    result = Matcher(chosen, segmenter=sides)(pair.left, pair.right)
    for name in ("good", "bad <b>", "deep/unscored #1"):
        result.save(out / "predictions" / name)
    (out / "predictions" / "failed").mkdir()
    (out / "predictions" / "failed" / "failed.json").write_text(json.dumps({"reason": "no photograph"}))
    (out / "rows.csv").write_text(ROWS)
    return out


def rows(page: Path) -> list[Any]:
    text = page.read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    return list(data["rows"])


def test_the_worst_come_first_and_have_reports(evaluation: Path) -> None:
    told: list[str] = []
    page = save_overview(evaluation, 2, told.append)
    found = rows(page)
    assert [row["name"] for row in found] == ["failed", "bad <b>", "good", "deep/unscored #1"]
    assert found[0]["remark"] == "failed: no photograph"
    assert told == ["bad <b>"]
    assert [row["link"] for row in found] == [None, "./predictions/bad%20%3Cb%3E/report.html", None, None]
    assert found[1]["values"]["F1"] == 0.25
    assert found[1]["values"]["matches"] == found[3]["values"]["matches"] > 10
    assert found[3]["values"]["F1"] is None
    assert all(row["thumbnail"].startswith("data:image/webp") for row in found[1:])
    again = page.read_bytes()
    assert save_overview(evaluation, 2).read_bytes() == again


def test_a_name_that_a_table_would_take_for_a_formula_keeps_its_scores(tmp_path: Path) -> None:
    (tmp_path / "predictions" / "-1").mkdir(parents=True)
    (tmp_path / "predictions" / "-1" / "failed.json").write_text(json.dumps({"reason": "no photograph"}))
    write("title", [{"pair": "-1", "status": "ok", "error_R": 0.5}], tmp_path, "zpm2 eval")
    assert rows(save_overview(tmp_path, 0))[0]["values"]["error_R"] == 0.5


def test_nothing_below(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no result"):
        save_overview(tmp_path, 2)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_in_a_browser(run: Run, evaluation: Path, tmp_path: Path) -> None:
    code, out, _ = run("view", evaluation, "--no-open", "--reports", "4")
    assert (code, out) == (0, f"{evaluation / 'index.html'}\n")
    names = "[...document.querySelectorAll('#rows tr')].map((row) => row.cells[1].firstChild.textContent)"
    with Browser(tmp_path / "profile") as browser:
        browser.open(evaluation / "index.html")
        assert browser.run(names) == ["failed", "bad <b>", "good", "deep/unscored #1"]
        browser.run("[...document.querySelectorAll('#head button')].find((b) => b.textContent === 'Recall').click()")
        assert browser.run(names)[:2] == ["bad <b>", "good"]
        assert browser.run("location.hash") == "#sort=R"
        assert browser.run("document.documentElement.scrollWidth <= innerWidth")
        for link in browser.run("[...document.querySelectorAll('#rows td:nth-child(2) a')].map((a) => a.href)"):
            browser.call("Page.navigate", url=link)
            browser.wait("document.documentElement?.dataset.ready && document.getElementById('panel-left') !== null")
        assert browser.errors == []
