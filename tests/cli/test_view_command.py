"""`zpm2 view`: the page of a folder, made where it is missing."""

from pathlib import Path

import pytest
from rendered import Pair, Run

from zpm2.api import Matcher
from zpm2.config import assign, preset
from zpm2.segment.given.precomputed import PrecomputedSegmenter


@pytest.fixture(scope="module")
def opened() -> list[str]:
    return []


@pytest.fixture(autouse=True)
def no_browser(monkeypatch: pytest.MonkeyPatch, opened: list[str]) -> None:
    opened.clear()
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)) or True)


@pytest.fixture(scope="module")
def result(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    chosen = assign(preset("default"), ["points.methods=sift", "device=cpu"])
    return Matcher(chosen, segmenter=sides)(pair.left, pair.right).save(tmp_path_factory.mktemp("view") / "out")


def test_a_missing_report_is_made(run: Run, result: Path, opened: list[str]) -> None:
    page = result / "report.html"
    assert not page.exists()
    assert run("view", result, "--no-open") == (0, f"{page}\n", "")
    assert opened == []
    assert run("view", result / "matches.json") == (0, f"{page}\n", "")
    assert opened == [page.as_uri()]


def test_a_report_of_the_user_stays(run: Run, pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    done = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--no-report")
    assert done.code == 2
    assert "report.html" in done.err
    assert (tmp_path / "report.html").read_text() == "mine"


def test_without_a_browser(run: Run, result: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    code, _, said = run("view", result)
    assert code == 2
    assert f"open {result / 'report.html'} yourself" in said


def test_tracks(run: Run, tmp_path: Path, opened: list[str]) -> None:
    (tmp_path / "tracks.json").write_text("{}")
    code, _, said = run("view", tmp_path)
    assert code == 2
    assert "run zpm2 tracks again" in said
    (tmp_path / "report.html").write_text("tracks")
    assert run("view", tmp_path).code == 0
    assert opened == [(tmp_path / "report.html").as_uri()]


def test_a_cloud(run: Run, tmp_path: Path, opened: list[str]) -> None:
    (tmp_path / "cloud.html").write_text("a cloud")
    assert run("view", tmp_path).code == 0
    assert opened == [(tmp_path / "cloud.html").as_uri()]


def test_other_files(run: Run, result: Path) -> None:
    for name in ("left.geojson", "overlay.png"):
        code, _, said = run("view", result / name, "--no-open")
        assert (code, said) == (2, f"zpm2: {result / name} is not a file of a result: give its folder\n")


def test_other_folders(run: Run, tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nothing"):
        code, _, said = run("view", folder, "--no-open")
        assert (code, said.count("\n")) == (2, 1)
        assert "holds no result" in said
