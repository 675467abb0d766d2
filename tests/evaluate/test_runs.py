"""Predictions to files, rows from files, interruption and damage."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import box, result
from remembered import remembered
from rendered import Pair, Run

from zpm2.config import assign, preset
from zpm2.errors import InputError
from zpm2.evaluate import predictions, report
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.ground_truth import CoVisible, from_disparity
from zpm2.evaluate.pairs import EvalPair, PoseTruth
from zpm2.pipeline import PairMatcher
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter

SIFT = assign(preset("paper"), ["points.methods=sift", "device=cpu"])


@pytest.fixture
def root(pair: Pair, tmp_path: Path) -> Path:
    """A data set of four pairs: good truth, no truth, damaged truth, a photograph that is none."""
    disparity = np.nan_to_num(pair.scene.disparity * 100).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "disparity.png"), disparity)
    (tmp_path / "damaged.png").write_bytes((tmp_path / "disparity.png").read_bytes()[:200])
    (tmp_path / "text.png").write_text("no picture")
    truth = {"kind": "disparity", "file": "disparity.png", "scale": 100}
    known = {"left": str(pair.left), "right": str(pair.right)}
    pairs = [
        {"name": "a/good", **known, "gt": truth},
        {"name": "b", **known, "gt": None},
        {"name": "c", **known, "gt": {**truth, "file": "damaged.png"}},
        {"name": "d", **known, "left": "text.png", "gt": truth},
    ]
    (tmp_path / "pairs.json").write_text(json.dumps(pairs))
    return tmp_path


FOUND: dict[tuple[object, object], MatchResult] = {}  # by photographs: each pair is matched once for all tests


class Counting:
    """A matcher of known regions that counts its calls and can be interrupted."""

    def __init__(self, pair: Pair, interrupt_at: int | None = None) -> None:
        regions = (PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions))
        self.matcher = PairMatcher(SIFT, segmenter=regions)
        self.interrupt_at, self.calls, self.loads = interrupt_at, 0, 0

    def load(self) -> "Counting":
        self.loads += 1
        return self

    def __call__(self, asked: EvalPair) -> MatchResult:
        self.calls += 1
        if self.calls == self.interrupt_at:
            raise KeyboardInterrupt
        pair = asked.left, asked.right
        if pair not in FOUND:
            FOUND[pair] = self.matcher(*pair)
        return FOUND[pair]


def test_rows_of_all_kinds_of_pairs(root: Path, pair: Pair, tmp_path: Path) -> None:
    pairs, out = list(open_dataset("pairs", root).pairs()), tmp_path / "out"
    predictions.predict(pairs, Counting(pair).load, out, lambda _: None)
    rows = report.collect(pairs, out, lambda _: None)
    assert [r["pair"] for r in rows] == ["a/good", "b", "c", "d"]
    good, unknown, damaged, unreadable = rows
    assert good["status"] == unknown["status"] == "ok"
    assert good["P"] > 0.8
    assert good["good"] > 20
    assert "P" not in unknown
    assert unknown["matches"] == good["matches"]
    assert "damaged.png" in damaged["status"]
    assert damaged["matches"] == good["matches"]
    assert "text.png" in unreadable["status"]
    total = report.summary(rows)
    assert (total["pairs"], total["done"], total["dense"], total["problems"]) == (4, 3, 1, 2)
    assert total["P"] == good["P"]


def test_an_interruption_loses_the_pair_in_work_only(root: Path, pair: Pair, tmp_path: Path) -> None:
    pairs, out = list(open_dataset("pairs", root).pairs())[:3], tmp_path / "out"
    first = Counting(pair, interrupt_at=2)
    with pytest.raises(KeyboardInterrupt):
        predictions.predict(pairs, first.load, out, lambda _: None)
    assert [predictions.load(p, out) is not None for p in pairs] == [True, False, False]
    second = Counting(pair)
    predictions.predict(pairs, second.load, out, lambda _: None)
    assert (second.loads, second.calls) == (1, 2)
    third = Counting(pair)
    predictions.predict(pairs, third.load, out, lambda _: None)
    assert (third.loads, third.calls) == (0, 0)
    assert len(report.collect(pairs, out, lambda _: None)) == 3


def test_two_runs_do_not_mix(tmp_path: Path) -> None:
    run = predictions.PredictionSettings("pairs", None, "zpm2", SIFT.to_dict())
    run.claim(tmp_path)
    run.claim(tmp_path)
    other = predictions.PredictionSettings("pairs", None, "zpm2", preset("default").to_dict())
    with pytest.raises(InputError, match="another config"):
        other.claim(tmp_path)


def test_files_say_what_the_rows_say(root: Path, pair: Pair, tmp_path: Path) -> None:
    pairs, out = list(open_dataset("pairs", root).pairs()), tmp_path / "out"
    predictions.predict(pairs[:2], Counting(pair).load, out, lambda _: None)
    rows = report.collect(pairs, out, lambda _: None)
    report.write("title", rows, out, "zpm2 eval", parquet=True)
    with (out / "rows.csv").open() as file:
        read = list(csv.DictReader(file))
    assert [r["pair"] for r in read] == [r["pair"] for r in rows]
    assert float(read[0]["MAS"]) == rows[0]["MAS"]
    parquet = pytest.importorskip("pyarrow.parquet").read_table(out / "rows.parquet")
    assert parquet.column("MAS").to_pylist()[0] == rows[0]["MAS"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["good"] == rows[0]["good"]
    text = (out / "summary.md").read_text()
    assert "- c: missing" in text
    assert "| a/good |" in text


@pytest.mark.parametrize(
    "name", ["=1+1", "+1", "-1", "@SUM(A1)", " =1", "\t=1", "\r=1", "＝1", "-", "=cmd|' /C calc'!A0"]
)
def test_no_name_is_a_formula_in_a_table(tmp_path: Path, name: str) -> None:
    rows = [{"pair": name, "status": name, "MAS": -0.5, "good": -1}, {"pair": "a=1-b", "status": "ok"}]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(report, "summary", lambda rows: {})
        patched.setattr(report, "markdown", lambda *rest: "")
        report.write("title", rows, tmp_path, "zpm2 eval")
    with (tmp_path / "rows.csv").open(newline="") as file:
        first, second = csv.DictReader(file)
    assert first["pair"] == first["status"] == f"'{name}"
    assert (first["MAS"], first["good"], second["pair"]) == ("-0.5", "-1", "a=1-b")


def test_coverage_is_a_ratio_only_where_something_is_true() -> None:
    full = from_disparity(np.full((80, 120), 10.0), (120, 80))
    here = (full.left[:, 0] < 40) | (full.left[:, 0] > 50)  # the centre of the polygon is not known
    part = CoVisible(full.left[here], full.right[here])
    found = result([box(0, 20, 20, 70, 60)], [box(0, 10, 20, 60, 60)], [(0, 0)], (120, 80))
    rows = [{"status": "ok", "matches": 1, **report._dense(found, truth)} for truth in (full, part)]
    assert [row["gt"] for row in rows] == [1, 1]
    assert [row["ACR_paper"] for row in rows] == [1.0, None]
    total = report.summary(rows)
    assert (total["ACR"], total["ACR_paper"], total["R_paper"]) == (1.0, 1.0, 0.5)


def test_cameras_that_only_turned_ask_for_no_translation() -> None:
    truth = PoseTruth((np.eye(3), np.eye(3)), np.eye(4))
    assert report._pose_errors((np.eye(3), None), truth) == (0.0, 0.0)
    assert report._pose_errors(None, truth) == (float("inf"), float("inf"))


def test_no_name_is_markup_in_a_table() -> None:
    line = report.table(["pair"], [["a|b\n<img src=x>"]]).splitlines()[-1]
    assert line == "| a\\|b &lt;img src=x> |"


def test_a_damaged_prediction_is_a_problem_of_its_pair(root: Path, pair: Pair, tmp_path: Path) -> None:
    pairs, out = list(open_dataset("pairs", root).pairs())[:2], tmp_path / "out"
    predictions.predict(pairs, Counting(pair).load, out, lambda _: None)
    (predictions.folder_of(pairs[0], out) / "matches.json").write_text("{")
    rows = report.collect(pairs, out, lambda _: None)
    assert "is not JSON" in rows[0]["status"]
    assert rows[1]["status"] == "ok"


@pytest.mark.weights
def test_the_command(run: Run, root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["eval", "pairs", "--root", root, "-o", out, "--set", "segment.grid=6", "--limit", 2]
    words += ["--set", "points.max_keypoints=1000"]
    with remembered():  # both pairs are of the same photographs
        code, text, err = run(*words)
    assert code == 0, err
    assert json.loads(text[: text.rindex("}") + 1])["done"] == 2
    assert "matched 2 of 2: b" in err
    code, again, err = run(*words, "--score-only", "--quiet")
    assert (code, again, err) == (0, "", "")
    code, _, err = run(*words, "--preset", "paper")
    assert (code, err.count("\n")) == (2, 1)
    assert "another config" in err


def test_regions_of_another_evaluation(run: Run, root: Path, pair: Pair, tmp_path: Path) -> None:
    pairs, first, second = list(open_dataset("pairs", root).pairs())[:2], tmp_path / "first", tmp_path / "second"
    predictions.PredictionSettings("pairs", None, "zpm2", SIFT.to_dict()).claim(first)
    predictions.predict(pairs[:1], Counting(pair).load, first, lambda _: None)
    words = ["eval", "pairs", "--root", root, "-o", second, "--limit", 2, "--method", "shape-context"]
    code, text, err = run(*words, "--regions", first)
    assert code == 0, err
    assert f"warning: b: no regions of b in {first}" in err
    assert json.loads(text[: text.rindex("}") + 1])["done"] == 1
    before, after = (MatchResult.load(predictions.folder_of(pairs[0], out)) for out in (first, second))
    for mine, theirs in ((before.left, after.left), (before.right, after.right)):
        assert [p.id for p in mine.polygons] == [p.id for p in theirs.polygons]
        assert all((p.exterior == q.exterior).all() for p, q in zip(mine.polygons, theirs.polygons, strict=True))
    assert any("not detected" in note for note in after.notes)
    code, _, err = run(*words)
    assert "another regions" in err
    code, _, err = run(*words, "--regions", tmp_path / "nothing")
    assert (code, err.count("\n")) == (2, 1)
    assert "holds no predictions to take regions from" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pairz"], "did you mean 'pairs'"),
        (["kitti2015"], "/training, not there: check the path"),
        (["pairs", "--method", "sift"], "methods are: zpm2, shape-context, idsc"),
        (["pairs", "--limit", "0"], "Invalid value for '--limit'"),
    ],
)
def test_misuse_is_one_line(run: Run, tmp_path: Path, words: list[str], message: str) -> None:
    (tmp_path / "pairs.json").write_text("[]")
    code, out, err = run("eval", *words, "--root", tmp_path, "-o", tmp_path / "out")
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert message in err


@pytest.fixture
def posed(pair: Pair, tmp_path: Path) -> Path:
    """A pair of which the cameras are known: ScanNet1500's text index with the rendered photographs."""
    scene, folder = pair.scene, tmp_path / "scannet"
    folder.mkdir()
    names = [f"scene0707_00_frame-{k:06d}.png" for k in (15, 30)]
    for name, source in zip(names, (pair.left, pair.right), strict=True):
        (folder / name).write_bytes(source.read_bytes())
    # the index is for pictures of 1296 x 968 px and counts pixel centres from 0
    scale = np.diag([1296 / 400, 968 / 240, 1.0])
    k = scale @ np.array([[scene.f, 0, scene.cx], [0, scene.f, scene.cy], [0, 0, 1]]) - [
        [0, 0, 0.5],
        [0, 0, 0.5],
        [0] * 3,
    ]
    move = np.eye(4)
    move[0, 3] = -scene.baseline
    numbers = [*k.ravel(), *k.ravel(), *move.ravel()]
    (folder / "scannet_test_pairs_with_gt.txt").write_text(" ".join([*names, "0", "0", *map(str, numbers)]) + "\n")
    return folder


def test_poses_are_predicted_and_scored_beside_plain_points(pair: Pair, posed: Path, tmp_path: Path) -> None:
    from zpm2.config import assign
    from zpm2.pose import PoseFinder

    pairs, out = list(open_dataset("scannet1500", posed).pairs()), tmp_path / "out"
    finder = PoseFinder(assign(SIFT, ["pose.crops=off"]))

    def pose_of(asked: EvalPair, result: MatchResult) -> object:
        return finder(result, report.cameras_of(result, asked.truth))

    predictions.predict(pairs, Counting(pair).load, out, lambda _: None, pose_of)
    (row,) = report.collect(pairs, out, lambda _: None)
    assert row["status"] == "ok"
    for kind in ("", "_points"):
        assert row[f"error_R{kind}"] < 1
        assert row[f"error_t{kind}"] < 5
    assert 0 < row["pose_inliers"] <= row["pose_points"] <= row["points"]
    assert row["s_pose"] > 0
    total = report.summary([row])
    assert total["posed"] == total["posed_points"] == 1
    assert total["AUC10"] > 0.5
    lines = report.pose_table([row]).splitlines()
    assert "| LoFTR | 22.1" in "\n".join(lines)
    assert lines[-2].startswith("| zpm2 |")
    assert lines[-1].startswith("| zpm2, all points, no polygons |")


def test_another_method_with_points_has_a_pose_too(pair: Pair, posed: Path) -> None:
    from zpm2 import api
    from zpm2.baselines import BaselineMatcher
    from zpm2.evaluate.pose_error import pose_error
    from zpm2.pose import PoseFinder

    (asked,) = open_dataset("scannet1500", posed).pairs()
    regions = (PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions))
    result = BaselineMatcher("mesa", SIFT, segmenter=regions)(asked.left, asked.right)
    found = PoseFinder(assign(SIFT, ["pose.crops=off"]))(result, report.cameras_of(result, asked.truth)).pose
    errors = pose_error(found.rotation, found.translation, asked.truth.pose)
    assert errors[0] < 1
    assert errors[1] < 5
    assert [api.finds_points(method) for method in ("zpm2", "mesa", "masa", "idsc")] == [True, True, False, False]


def test_all_points_means_all() -> None:
    """Beside polygons stands what the points give without them: none filtered, none from crops, none left out."""
    plain = report.without_polygons(preset("default")).pose
    assert (plain.points, plain.crops, plain.bucket) == ("all", "off", 0)
    assert (plain.estimator, plain.noise_px) == (preset("default").pose.estimator, preset("default").pose.noise_px)


def test_a_pair_without_a_predicted_pose_has_that_of_its_points(pair: Pair, posed: Path, tmp_path: Path) -> None:
    pairs, out = list(open_dataset("scannet1500", posed).pairs()), tmp_path / "out"
    predictions.predict(pairs, Counting(pair).load, out, lambda _: None)
    (row,) = report.collect(pairs, out, lambda _: None)
    assert "error_R" not in row
    assert row["error_R_points"] < 1
    assert "posed" not in report.summary([row])


def test_scannet1500_prints_the_published_rows(pair: Pair, posed: Path, run: Run, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("zpm2.evaluate.run._matcher", lambda *_: Counting(pair))
    options = ["--preset", "paper", "--set", "pose.crops=off", "--set", "device=cpu"]
    code, text, err = run("eval", "scannet1500", "--root", posed, "-o", tmp_path / "out", *options)
    assert code == 0, err
    assert "MESA + LoFTR" in text
    assert "published, not measured here" in (tmp_path / "out" / "summary.md").read_text()
    assert (tmp_path / "out" / "predictions" / pairs_name(posed) / "pose.json").exists()


def pairs_name(posed: Path) -> str:
    return next(iter(open_dataset("scannet1500", posed).pairs())).name
