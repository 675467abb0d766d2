"""A saved result works from anywhere: from another working directory, moved with its photographs, and moved alone."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from rendered import Pair

from zpm2 import MatchResult
from zpm2.cli import app
from zpm2.errors import InputError


@pytest.fixture(scope="module")
def made(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with photographs and, in out/, a result that was made there with relative names; beside it, a copy."""
    folder = tmp_path_factory.mktemp("made") / "project"
    (folder / "photographs").mkdir(parents=True)
    for side in ("left", "right"):
        shutil.copy(getattr(pair, side), folder / "photographs" / f"{side}.png")
    words = ("photographs/left.png", "photographs/right.png", "-o", "out", *pair.regions)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", ["zpm2", "match", *words])
        with pytest.raises(SystemExit) as left:
            app.main()
    assert left.value.code == 0
    shutil.copytree(folder, folder.with_name("copy"))
    return folder


@pytest.fixture
def project(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder as it was made, in its place."""
    shutil.rmtree(made, ignore_errors=True)
    shutil.copytree(made.with_name("copy"), made)
    monkeypatch.chdir(tmp_path)
    return made


def works(out: Path, photographs: Path, other: Path) -> None:
    """Drawn, and saved once more, with the photographs of that folder."""
    loaded = MatchResult.load(out)
    assert loaded.left.path is not None
    assert os.path.realpath(loaded.left.path) == os.path.realpath(photographs / "left.png")
    assert np.asarray(loaded.plot(600)).std() > 10
    loaded.save(other)
    again = MatchResult.load(other)
    assert again.left.path == loaded.left.path
    assert [m.left for m in again.matches] == [m.left for m in loaded.matches]


def test_from_another_working_directory(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    works(project / "out", project / "photographs", tmp_path / "other")
    monkeypatch.chdir(project)
    works(Path("out"), project / "photographs", Path("deep/other"))
    document = json.loads((project / "deep" / "other" / "matches.json").read_text())
    assert document["left"]["path"] == str(project / "photographs" / "left.png")
    assert document["left"]["relative_path"] == "../../photographs/left.png"


def test_moved_with_the_photographs(project: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere" / "moved"
    shutil.copytree(project, moved)
    works(moved / "out", moved / "photographs", tmp_path / "other")
    shutil.rmtree(project)
    works(moved / "out", moved / "photographs", tmp_path / "another")


def test_moved_alone(project: Path, tmp_path: Path) -> None:
    (project / "out").rename(tmp_path / "out")
    works(tmp_path / "out", project / "photographs", tmp_path / "other")


def test_moved_to_where_another_photograph_has_that_name(project: Path, tmp_path: Path) -> None:
    (tmp_path / "second" / "photographs").mkdir(parents=True)
    for side in ("left", "right"):
        picture = PIL.Image.open(project / "photographs" / f"{side}.png").transpose(PIL.Image.Transpose.ROTATE_180)
        picture.save(tmp_path / "second" / "photographs" / f"{side}.png")
    (project / "out").rename(tmp_path / "second" / "out")
    works(tmp_path / "second" / "out", project / "photographs", tmp_path / "other")


def test_through_a_link_to_the_folder(project: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(project / "out")
    works(tmp_path / "link", project / "photographs", tmp_path / "other")
    MatchResult.load(project / "out").save(tmp_path / "link")
    works(project / "out", project / "photographs", tmp_path / "another")


def test_a_result_that_is_saved_from_another_working_directory(
    project: Path, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zpm2 import config
    from zpm2.pipeline import PairMatcher
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    chosen = config.assign(config.preset("default"), ["points.methods=sift", "device=cpu"])
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    monkeypatch.chdir(project / "photographs")
    result = PairMatcher(chosen, segmenter=sides)("left.png", "right.png")
    monkeypatch.chdir(tmp_path)
    result.save(tmp_path / "late")
    works(tmp_path / "late", project / "photographs", tmp_path / "other")


def test_photographs_that_are_gone_are_named(project: Path) -> None:
    (project / "photographs" / "right.png").unlink()
    with pytest.raises(InputError, match=r"right image .*project/photographs/right\.png does not exist"):
        MatchResult.load(project / "out").plot()


def test_results_of_earlier_versions_are_read(project: Path) -> None:
    """They had a path as it was typed."""
    file = project / "out" / "matches.json"
    document = json.loads(file.read_text())
    for side in ("left", "right"):
        document[side] = {k: v for k, v in document[side].items() if k not in ("relative_path", "content")}
    file.write_text(json.dumps(document))
    assert MatchResult.load(file).plot(600).width == 600
