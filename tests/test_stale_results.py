"""What an earlier run left is taken only where inputs, configuration and code are the same."""

import dataclasses
import json
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import boards
import numpy as np
import PIL.Image
import pytest
from rendered import Outcome, Pair, Run, save_pair

from zpm2 import MatchResult
from zpm2.api import Matcher
from zpm2.config import assign, preset
from zpm2.errors import OutputError
from zpm2.evaluate import predictions
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import EvalPair
from zpm2.evaluate.rendered import render_scene
from zpm2.segment.given.precomputed import PrecomputedSegmenter

QUICK = ("--set", "points.methods=sift", "--device", "cpu")


@pytest.fixture(autouse=True)
def as_in_a_terminal() -> Iterator[None]:
    """Ctrl-C interrupts, also where pytest is a job in the background of a script, in which shells ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Counting:
    """Stands for a matcher's class and for the matcher; remembers what it was asked."""

    def __init__(self, pair: Pair, few: int | None = None) -> None:
        self.few = few  # number of matches that it gives; all
        chosen = assign(preset("default"), ["points.methods=sift", "device=cpu"])
        sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
        self.matcher, self.asked = Matcher(chosen, segmenter=sides), 0
        self.found: dict[tuple[object, ...], MatchResult] = {}  # the same photographs are matched once

    def __call__(self, *words: object, **named: object) -> object:
        if len(words) != 2:
            return self
        self.asked += 1
        key = *words, *(Path(str(path)).read_bytes() for path in words)
        if key not in self.found:
            self.found[key] = self.matcher(words[0], words[1])  # type: ignore[arg-type]
        return dataclasses.replace(self.found[key], matches=self.found[key].matches[: self.few])


@pytest.fixture
def photographs(pair: Pair, tmp_path: Path) -> tuple[Path, Path]:
    """Copies that may be changed."""
    return (
        Path(shutil.copy(pair.left, tmp_path / "left.png")),
        Path(shutil.copy(pair.right, tmp_path / "right.png")),
    )


def replace(path: Path) -> None:
    """Another photograph of the same name, size in px, and time."""
    time = path.stat().st_mtime_ns
    pixels = np.asarray(PIL.Image.open(path)).copy()
    pixels[100:110, 100:110] = 255 - pixels[100:110, 100:110]
    PIL.Image.fromarray(pixels).save(path)
    os.utime(path, ns=(time, time))


def test_pairs_of_a_cloud(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("trimesh")
    pair = save_pair(render_scene(0, 200, 120), tmp_path)  # small: there are nine runs
    photographs = pair.left, pair.right
    counting = Counting(pair, few=4)
    monkeypatch.setattr("zpm2.api.Matcher", counting)
    monkeypatch.setattr("zpm2.cloud.save", lambda *words: [])
    scene = pair.scene
    rig = ("--stereo", "--K", f"{scene.f},{scene.f},{scene.cx},{scene.cy}", "--baseline", 0.2)

    def asked(*more: object) -> int:
        before = counting.asked
        code, _, err = run("cloud", *photographs, *rig, "-o", tmp_path / "out", *QUICK, *more)
        assert code == 0, err
        return counting.asked - before

    assert [asked(), asked(), asked("--set", "cloud.step=5")] == [1, 0, 0]
    replace(photographs[1])
    assert [asked(), asked()] == [1, 0]
    assert [asked("--seed", 5), asked("--seed", 5), asked()] == [1, 0, 1]
    with monkeypatch.context() as patch:
        patch.setattr("zpm2.files.keys.code", lambda: "other")
        assert [asked(), asked()] == [1, 0]


def test_predictions(pair: Pair, photographs: tuple[Path, Path], tmp_path: Path) -> None:
    asked, out = EvalPair("a", *photographs), tmp_path / "out"
    matcher = Counting(pair)

    def predict(regions: Path | None = None) -> int:
        before = matcher.asked
        predictions.predict(
            [asked],
            lambda: lambda p: matcher(p.left, p.right),
            out,
            lambda _: None,
            regions=regions,  # type: ignore
        )
        return matcher.asked - before

    assert [predict(), predict()] == [1, 0]
    assert predictions.is_current(asked, out)
    replace(photographs[0])
    assert not predictions.is_current(asked, out)
    assert [predict(), predict()] == [1, 0]
    assert predictions.is_current(asked, out)
    shutil.copytree(out, tmp_path / "regions")
    assert [predict(tmp_path / "regions"), predict(tmp_path / "regions")] == [1, 0]
    (tmp_path / "regions" / "predictions" / "a" / "matches.json").write_text("{}")
    assert predict(tmp_path / "regions") == 1
    photographs[0].write_text("no photograph")
    predict()
    assert "left image" in str(predictions.load(asked, out))  # not what was there before
    photographs[0].write_bytes(pair.left.read_bytes())
    predict()
    assert isinstance(predictions.load(asked, out), MatchResult)


def test_predictions_of_other_code_do_not_mix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    predictions.PredictionSettings("pairs", None, "zpm2", {}).claim(tmp_path)
    monkeypatch.setattr("zpm2.evaluate.predictions.code", lambda: "other")
    with pytest.raises(predictions.InputError, match="with another code"):
        predictions.PredictionSettings("pairs", None, "zpm2", {}, code="other").claim(tmp_path)


def test_regions_of_another_photograph(pair: Pair, photographs: tuple[Path, Path], run: Run, tmp_path: Path) -> None:
    entries = [{"name": "a", "left": "left.png", "right": "right.png", "gt": None}]
    (tmp_path / "pairs.json").write_text(json.dumps(entries))
    pairs, first = list(open_dataset("pairs", tmp_path).pairs()), tmp_path / "first"
    predictions.PredictionSettings("pairs", None, "zpm2", {}).claim(first)
    matcher = Counting(pair)
    predictions.predict(pairs, lambda: lambda p: matcher(p.left, p.right), first, lambda _: None)  # type: ignore
    words = ("eval", "pairs", "--root", tmp_path, "--method", "shape-context", "--regions", first, "-q")
    assert run(*words, "-o", tmp_path / "second").err == ""
    replace(photographs[0])
    err = run(*words, "-o", tmp_path / "third").err
    assert f"warning: a: the regions of a in {first} are of other photographs" in err


def test_a_reconstruction(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pycolmap")
    paths = boards.write(tmp_path / "photographs", 2)

    class StopError(Exception):
        pass

    def stop(*_: object) -> None:
        raise StopError

    monkeypatch.setattr("zpm2.reconstruct.workspace.find_structure", stop)
    words = ("reconstruct", tmp_path / "photographs", "-o", tmp_path / "ws")
    for _ in range(2):
        with pytest.raises(StopError):
            run(*words)
    with monkeypatch.context() as patch:
        patch.setattr("zpm2.reconstruct.workspace.code", lambda: "other")
        assert "with other code: give another folder" in run(*words).err
    assert "with other options: give another folder" in run(*words, "--max-size", 300).err
    replace(paths[1])
    assert "with other photographs: give another folder" in run(*words).err


def tiled(run: Run, pair: Pair, out: Path, *more: object) -> Outcome:
    return run("match", pair.left, pair.right, "-o", out, *pair.regions, "--tiles", "on", *SIZE, *more)


SIZE = ("--set", "tiles.size=256")


def test_ctrl_c_says_what_is_kept_and_the_next_run_takes_it(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, tiles = tmp_path / "deep" / "out", tmp_path / "deep" / "out" / ".zpm2" / "tiles"
    with monkeypatch.context() as patch:
        patch.setattr("zpm2.tiled.run.given_regions", lambda *_: signal.raise_signal(signal.SIGINT))
        code, _, err = tiled(run, pair, out)
    assert code == 130
    said = f"zpm2: interrupted; what is finished is kept in {tiles}: run the same command again to go on"
    assert said in err.splitlines()
    assert [p.name for p in out.iterdir()] == [".zpm2"]
    number = len(list(tiles.glob("*/*")))
    assert number > 1
    code, _, err = tiled(run, pair, out)
    assert code == 0
    assert f"{number} of {number} tiles were finished by an earlier run" in err
    assert "earlier run" not in " ".join(MatchResult.load(out).notes)  # the same result as of one run
    assert not tiles.exists()


def test_tiles_of_other_region_files_are_not_taken(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Path(shutil.copy(pair.left_regions, tmp_path / "labels.png"))
    more = ("--left-regions", own)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("zpm2.tiled.run.given_regions", interrupt)
        assert tiled(run, pair, tmp_path / "out", *more).code == 130
        replace(own)
        assert tiled(run, pair, tmp_path / "out", *more).code == 130
    assert len(list((tmp_path / "out" / ".zpm2" / "tiles").iterdir())) == 2


def test_ctrl_c_before_anything_is_finished_leaves_nothing(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zpm2.pipeline.search_candidates", lambda *_: signal.raise_signal(signal.SIGINT))
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path / "deep" / "out", *pair.regions)
    assert (code, "kept" in err) == (130, False)
    assert not (tmp_path / "deep").exists()


def test_a_rerun_leaves_a_result_in_a_folder_of_its_own(run: Run, pair: Pair, tmp_path: Path) -> None:
    common = "match", pair.left, pair.right, *pair.regions, "--quiet", "-o"
    for out in (tmp_path, tmp_path / "masks", tmp_path):
        assert run(*common, out).code == 0
    assert (tmp_path / "masks" / "matches.json").is_file()


def test_a_changed_file_stops_a_rerun_before_anything_is_removed(run: Run, pair: Pair, tmp_path: Path) -> None:
    common = "match", pair.left, pair.right, *pair.regions, "--quiet", "-o", tmp_path, "--format"
    assert run(*common, "coco").code == 0
    record = tmp_path / ".zpm2" / "made.jsonl"
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file() and path != record}
    made = MatchResult.load(tmp_path)
    (tmp_path / "overlay.png").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"overlay\.png was changed since"):
        made.save(tmp_path)
    after = {path: path.read_bytes() for path in before}
    assert after == before | {tmp_path / "overlay.png": b"mine"}


def test_a_rerun_leaves_no_file_of_the_earlier_run(run: Run, pair: Pair, tmp_path: Path) -> None:
    common = "match", pair.left, pair.right, "-o", tmp_path, *pair.regions
    assert run(*common, "--format", "coco", "--format", "yolo", "--masks", "colmap").code == 0
    mine = tmp_path / "masks" / "mine.txt", tmp_path / "left.yolo.txt"
    for path in mine:
        path.write_text("mine")
    code, _, err = run(*common, "--no-report")
    assert code == 0, err
    left = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file())
    ours = ["left.geojson", "matches.json", "overlay.png", "right.geojson", "unmatched.png"]
    assert [name for name in left if not name.startswith(".")] == sorted([*ours, "left.yolo.txt", "masks/mine.txt"])
    assert {path.read_text() for path in mine} == {"mine"}
