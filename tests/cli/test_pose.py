"""`zpm2 pose` as people type it, on the rendered pair: what it writes, and one line for what it cannot use."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from rendered import Pair, Run

from zpm2 import MatchResult
from zpm2.model import PointMatches

QUICK = ["--set", "pose.crops=off", "--device", "cpu"]


@pytest.fixture(scope="module")
def matches(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from zpm2.config import assign, preset
    from zpm2.pipeline import PairMatcher
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    config = assign(preset("paper"), ["points.methods=sift", "device=cpu"])
    regions = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    result = PairMatcher(config, segmenter=regions)(pair.left, pair.right)
    return result.save(tmp_path_factory.mktemp("matches"))


@pytest.fixture
def k(pair: Pair) -> str:
    scene = pair.scene
    return f"{scene.f},{scene.f},{scene.cx},{scene.cy}"


def test_pose_of_the_rendered_pair(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "pose"
    words = ["--K", k, "--matches", matches, "--baseline", pair.scene.baseline, "--rectify", *QUICK]
    code, text, err = run("pose", pair.left, pair.right, "-o", out, *words)
    assert code == 0, err
    assert "points agree" in text
    document = json.loads((out / "pose.json").read_text())
    rotation, translation = (np.array(document["pose"][name]) for name in ("rotation", "translation"))
    assert np.degrees(np.arccos((np.trace(rotation) - 1) / 2)) < 0.3
    assert np.linalg.norm(translation - [-pair.scene.baseline, 0, 0]) < 0.05 * pair.scene.baseline
    assert document["pose"]["metric"] is True
    rectified = json.loads((out / "rectified" / "rectification.json").read_text())
    assert rectified["vertical"] is False
    for side in ("left", "right"):
        picture = PIL.Image.open(out / "rectified" / f"{side}.png")
        assert abs(picture.width - 400) < 40
        assert len(json.loads((out / "rectified" / f"{side}.geojson").read_text())["features"]) > 10


def test_colmap(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    out = tmp_path / "pose"
    words = ["--K", k, "--matches", matches, "--colmap", *QUICK]
    assert run("pose", pair.left, pair.right, "-o", out, *words).code == 0
    model = pycolmap.Reconstruction(str(out / "colmap" / "sparse" / "0"))
    assert {image.name for image in model.images.values()} == {"left.png", "right.png"}


def test_colmap_of_photographs_of_one_name(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    """They keep their folders; one photograph twice is refused before anything is written."""
    pycolmap = pytest.importorskip("pycolmap")
    for side, path in (("left", pair.left), ("right", pair.right)):
        (tmp_path / side).mkdir()
        shutil.copy(path, tmp_path / side / "0.png")
    left, right = tmp_path / "left" / "0.png", tmp_path / "right" / "0.png"
    words = ["--K", k, "--matches", matches, "--colmap", *QUICK]
    code, _, err = run("pose", left, right, "-o", tmp_path / "pose", *words)
    assert code == 0, err
    model = pycolmap.Reconstruction(str(tmp_path / "pose" / "colmap" / "sparse" / "0"))
    assert {image.name for image in model.images.values()} == {"left/0.png", "right/0.png"}
    code, _, err = run("pose", left, left, "-o", tmp_path / "twice", *words)
    assert (code, (tmp_path / "twice").exists()) == (2, False)
    assert "given twice" in err


def test_each_photograph_has_its_own_camera_of_a_model(pair: Pair, matches: Path, run: Run, tmp_path: Path) -> None:
    for side, path in (("left", pair.left), ("right", pair.right)):
        (tmp_path / side).mkdir()
        shutil.copy(path, tmp_path / side / "0.png")
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 400 240 300 300 200 120\n2 PINHOLE 400 240 310 310 200 120\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 left/0.png\n\n\n2 1 0 0 0 0 0 0 2 right/0.png\n\n")
    photographs = tmp_path / "left" / "0.png", tmp_path / "right" / "0.png"
    code, _, err = run("pose", *photographs, "-o", tmp_path / "p", "--K", tmp_path, "--matches", matches, *QUICK)
    assert code == 0, err
    document = json.loads((tmp_path / "p" / "pose.json").read_text())
    assert [camera["matrix"][0][0] for camera in document["cameras"]] == [300, 310]


def test_a_camera_that_hardly_fits_is_said(pair: Pair, matches: Path, run: Run, tmp_path: Path) -> None:
    words = ["--K", "150,150,100,60", "--matches", matches, *QUICK]
    code, _, err = run("pose", pair.left, pair.right, "-o", tmp_path / "p", *words)
    assert "the left camera has its principal point at (100, 60), 25 % of a side from the middle" in err
    assert code != 2


def test_json(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    code, text, _ = run(
        "pose", pair.left, pair.right, "-o", tmp_path / "p", "--K", k, "--matches", matches, "--json", *QUICK
    )
    assert code == 0
    assert json.loads(text)["counts"]["inliers"] > 100


def test_it_matches_where_no_matches_are_given(
    pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zpm2.pipeline.PairMatcher.one_of_many", lambda *_, **__: MatchResult.load(matches))
    assert run("pose", pair.left, pair.right, "-o", tmp_path / "p", "--K", k, *QUICK).code == 0
    assert {f.name for f in (tmp_path / "p").iterdir()} >= {"pose.json", "matches.json", "overlay.png"}


def test_without_cameras_there_is_no_pose_but_a_result(pair: Pair, matches: Path, run: Run, tmp_path: Path) -> None:
    """A rectified pair does not tell its focal length, and a PNG has no EXIF."""
    code, _, err = run("pose", pair.left, pair.right, "-o", tmp_path / "p", "--matches", matches, *QUICK)
    assert code == 3
    assert "no pose" in err
    assert "K guess" in err
    document = json.loads((tmp_path / "p" / "pose.json").read_text())
    assert document["pose"] is None
    assert document["fundamental"] is not None


@pytest.mark.parametrize("how", ["unrelated", "mirrored"])
def test_without_a_pose_the_exit_code_is_3(
    how: str, pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path
) -> None:
    known = MatchResult.load(matches)
    right = known.points.right * [-1, 1] + [400, 0]
    if how == "unrelated":
        right = np.random.default_rng(0).permutation(right)
    changed = dataclasses.replace(known, points=PointMatches(known.points.left, right, known.points.score))
    changed.save(tmp_path / "m")
    words = ["--K", k, "--matches", tmp_path / "m", "--rectify", *QUICK]
    code, text, err = run("pose", pair.left, pair.right, "-o", tmp_path / "p", *words)
    assert code == 3
    assert "standard deviation" not in text
    assert ("mirrored" if how == "mirrored" else "chance") in err
    document = json.loads((tmp_path / "p" / "pose.json").read_text())
    assert document["pose"] is None
    assert document["failed"] in err


def test_a_guess_is_said(pair: Pair, matches: Path, run: Run, tmp_path: Path) -> None:
    code, _, err = run(
        "pose", pair.left, pair.right, "-o", tmp_path / "p", "--matches", matches, "--K", "guess", *QUICK
    )
    assert code == 0
    assert "480 px, is guessed" in err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--K", "0,0,200,120"], "focal lengths 0 and 0"),
        (["--K", "nan,300,200,120"], "not finite"),
        (["--K", "300,300,900,120"], "outside of the image of 400 x 240"),
        (["--K", "nothing.txt"], "is neither a file nor fx,fy,cx,cy"),
        (["--K", "300,300,120,200"], "fits 240 x 400 px"),
        (["--K", "300,300,200,120,0.1,0.1,0.1"], "3 coefficients"),
        (["--K", "300,200,300,120"], "that is 300,300,200,120"),
        (["--K2", "300,300,200,120"], "--K2 without --K"),
        (["--K", "exif"], "no focal length"),
        (["--K", "300,300,200,120", "--centers", "1"], "give 0.5 or 0"),
        (["--K", "300,300,200,120", "--baseline", "-1"], "above 0"),
        (["--K", "300,300,200,120", "--estimator", "magic"], "pose.estimator must be one of"),
        (["--K", "300,300,200,120", "--matches", "nowhere"], "cannot read"),
    ],
)
def test_one_line_for_what_cannot_be_used(words: list[str], why: str, pair: Pair, run: Run, tmp_path: Path) -> None:
    code, out, err = run("pose", pair.left, pair.right, "-o", tmp_path / "p", *words, *QUICK)
    assert code == 2
    assert why in err
    assert len(err.strip().splitlines()) == 1
    assert not out
    assert not (tmp_path / "p").exists()


def test_images_of_different_sizes_need_two_cameras(pair: Pair, k: str, run: Run, tmp_path: Path) -> None:
    PIL.Image.open(pair.right).resize((300, 200)).save(tmp_path / "small.png")
    code, _, err = run("pose", pair.left, tmp_path / "small.png", "-o", tmp_path / "p", "--K", k, *QUICK)
    assert code == 2
    assert "give --K2" in err


def test_matches_of_other_images(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    for name in ("a", "b"):
        PIL.Image.open(pair.left).resize((300, 200)).save(tmp_path / f"{name}.png")
    words = ["--K", "300,300,150,100", "--matches", matches, *QUICK]
    code, _, err = run("pose", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "p", *words)
    assert code == 2
    assert "give the images that were matched" in err


def test_matches_of_other_photographs_of_the_same_size(
    pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path
) -> None:
    """Another file may be the same photograph, written anew: a warning. Exchanged ones are a mistake."""
    with PIL.Image.open(pair.left) as picture:
        picture.save(tmp_path / "left.png", compress_level=1)
    words = ["-o", tmp_path / "p", "--K", k, "--matches", matches, *QUICK]
    code, _, err = run("pose", tmp_path / "left.png", pair.right, *words)
    assert code == 0, err
    assert "left.png is not the file that" in err
    assert "right.png is not" not in err
    assert "is not the file" not in run("pose", pair.left, pair.right, *words).err
    code, _, err = run("pose", pair.right, pair.left, *words)
    assert code == 2
    assert "the other way round: exchange them" in err
