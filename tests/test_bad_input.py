"""What goes wrong at the command line: one line that says what and what to do, exit code 2, nothing half-written."""

import errno
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from rendered import Outcome, Pair, Run, photograph, regions_of

Case = Callable[[Path, Pair], list[object]]  # (an empty folder, the good pair) -> arguments of `zpm2 match`


def check_refused(outcome: Outcome, *words: str) -> None:
    code, out, err = outcome
    assert code == 2, err
    assert out == ""
    assert err.startswith("zpm2: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert "Traceback" not in err
    for word in words:
        assert word in err


def truncated_jpeg(path: Path) -> Path:
    PIL.Image.fromarray(photograph(1)).save(path, "JPEG")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def text(path: Path, content: str = "not a picture") -> Path:
    path.write_text(content)
    return path


def dot(path: Path) -> Path:
    PIL.Image.new("RGB", (1, 1)).save(path)
    return path


def folder(path: Path) -> Path:
    path.mkdir()
    return path


PHOTOGRAPHS: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing.png": (lambda path: path, "does not exist: check the path"),
    "text.png": (text, "not a picture in a known format: give a PNG, JPEG or TIFF file"),
    "cut.jpg": (truncated_jpeg, "damaged or cut short"),
    "dot.png": (dot, "is 1 x 1 px: each side must have at least 32 px"),
    "folder.png": (folder, "is a folder: give the path of a picture in it"),
    "empty.png": (lambda path: text(path, ""), "is empty (0 bytes): copy or download it again"),
}


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_a_photograph_that_cannot_be_used(run: Run, pair: Pair, tmp_path: Path, name: str, side: str) -> None:
    make, message = PHOTOGRAPHS[name]
    make(tmp_path / name)
    files = {"left": pair.left, "right": pair.right, side: tmp_path / name}
    outcome = run("match", files["left"], files["right"], "-o", tmp_path / "out", *pair.regions)
    check_refused(outcome, f"{side} image {tmp_path / name}", message)
    assert not (tmp_path / "out").exists()


OPTIONS: dict[str, tuple[list[str], list[str]]] = {
    "preset": (["--preset", "papre"], ["unknown preset 'papre'", "did you mean 'paper'", "paper, default"]),
    "option": (["--bogus"], ["No such option: --bogus"]),
    "stage": (["--set", "segmnt.grid=8"], ["unknown option 'segmnt'", "did you mean 'segment'"]),
    "field": (["--set", "segment.gird=8"], ["unknown option 'segment.gird'", "did you mean 'grid'"]),
    "stage alone": (["--set", "segment=8"], ["'segment' is a stage", "grid"]),
    "type": (["--set", "segment.grid=many"], ["segment.grid must be of type int, got 'many'"]),
    "range": (["--set", "segment.nms_iou=1.5"], ["segment.nms_iou is a share from 0 to 1, got 1.5"]),
    "choice": (["--set", "local_match.shape=round"], ["local_match.shape must be one of graph, overlap"]),
    "no value": (["--set", "segment.grid"], ["--set segment.grid", "expected stage.field=value"]),
    "segmenter": (["--segmenter", "vit_x"], ["mobile_sam, vit_b, vit_l, vit_h", "'vit_x'"]),
    "points": (["--points", "shift"], ["unknown point method 'shift'", "did you mean 'sift'", "xfeat"]),
    "no points": (["--points", ""], ["the value after --points is empty"]),
    "seed": (["--seed", "one"], ["--seed"]),
    "negative seed": (["--seed", "-1"], ["seed must be a finite number >= 0"]),
    "device": (["--device", "tpu"], ["unknown device 'tpu'", "auto, cpu, cuda"]),
    "config missing": (["--config", "nowhere.toml"], ["cannot read configuration nowhere.toml"]),
    "weights folder": (["--weights-dir", "nowhere"], ["--weights-dir nowhere is not a folder: give one"]),
    "weights": (["--segmenter", "mobile_sam"], ["mobile_sam", "6dbb9052", "by hand", "--weights-dir"]),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_that_does_not_exist_or_cannot_be(run: Run, pair: Pair, tmp_path: Path, name: str) -> None:
    options, words = OPTIONS[name]
    out = tmp_path / "out"
    check_refused(run("match", pair.left, pair.right, "-o", out, "--points", "sift", *options), *words)
    assert not out.exists() or list(out.iterdir()) == []


@pytest.mark.parametrize("content", ["grid = ", "[segment]\ngird = 3", "[1]", "segment = 3"])
@pytest.mark.parametrize("ending", ["toml", "json"])
def test_a_configuration_file_that_cannot_be_used(
    run: Run, pair: Pair, tmp_path: Path, content: str, ending: str
) -> None:
    file = text(tmp_path / f"own.{ending}", content)
    check_refused(run("match", pair.left, pair.right, "-o", tmp_path / "out", "--config", file))
    assert not (tmp_path / "out").exists()


def test_cuda_where_there_is_none(run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    outcome = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--device", "cuda")
    check_refused(outcome, "device cuda is not available", "--device cpu")


def test_arguments_that_are_missing(run: Run, pair: Pair) -> None:
    check_refused(run("match", pair.left), "right", "zpm2 match --help")
    check_refused(run("eval", "pairs"), "'--root'", "zpm2 eval --help")
    check_refused(run("mtach"), "mtach")


@pytest.mark.parametrize(
    "options",
    [
        ["--segmenter", "precomputed"],
        ["--segmenter", "precomputed", "--left-regions", "l.png"],
        ["--right-regions", "r.png"],
        ["--segmenter", "vit_b", "--left-regions", "l.png", "--right-regions", "r.png"],
    ],
)
def test_regions_that_are_not_all_named(run: Run, pair: Pair, tmp_path: Path, options: list[str]) -> None:
    outcome = run("match", pair.left, pair.right, "-o", tmp_path / "out", *options)
    check_refused(outcome, "--segmenter precomputed --left-regions FILE --right-regions FILE")
    assert not (tmp_path / "out").exists()


def test_region_files_that_cannot_be_used(run: Run, pair: Pair, tmp_path: Path) -> None:
    small = tmp_path / "small.png"
    PIL.Image.fromarray(np.ones((40, 40), np.uint8)).save(small)
    cases = {
        tmp_path / "missing.png": "does not exist",
        text(tmp_path / "text.png"): "damaged",
        text(tmp_path / "own.geojson", "{}"): "no regions that can be read",
        text(tmp_path / "labels.csv"): "no regions that can be read",
        small: "40 x 40 px",
    }
    for file, message in cases.items():
        options = ["--segmenter", "precomputed", "--left-regions", pair.left_regions, "--right-regions", file]
        outcome = run("match", pair.left, pair.right, "-o", tmp_path / "out", *options, "--points", "sift")
        check_refused(outcome, str(file), message)
        assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


def test_output_that_cannot_be_written(run: Run, pair: Pair, tmp_path: Path) -> None:
    file = text(tmp_path / "file", "keep me")
    check_refused(run("match", pair.left, pair.right, "-o", file), f"output folder {file} is a file")
    check_refused(run("match", pair.left, pair.right, "-o", file / "below"), "is a file, not a folder")
    check_refused(run("match", pair.left, pair.right, "-o", pair.left), "one of the input files")
    check_refused(run("demo", "-o", file), "is a file")
    assert file.read_text() == "keep me"
    assert pair.left.stat().st_size > 1000


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc takes no folders, not even from root")
def test_output_in_a_place_that_takes_nothing(run: Run, pair: Pair) -> None:
    check_refused(run("match", pair.left, pair.right, "-o", "/proc/zpm2-out"), "/proc/zpm2-out")


@pytest.mark.parametrize("whole", [0, 1, 3, 8])
def test_a_full_disk_leaves_whole_files_only(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: int
) -> None:
    """`whole` files find room: all six are made first, and then take their places."""
    replace = os.replace
    done: list[str] = []

    def full(source: str, target: str) -> None:
        if len(done) == whole:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    outcome = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--quiet")
    check_refused(outcome, f"cannot write {tmp_path}", "the disk is full; free some space")
    placed = done[6:]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*placed, *([".zpm2"] if placed else [])])
    assert "matches.json" not in placed


def test_an_earlier_result_survives_a_failed_write(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    common = "match", pair.left, pair.right, "-o", tmp_path, *pair.regions
    assert run(*common).code == 0
    earlier = {p: p.read_bytes() for p in tmp_path.glob("*.*") if p.is_file()}

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    check_refused(run(*common, "--seed", 7), "the disk is full")
    assert {p: p.read_bytes() for p in tmp_path.glob("*.*") if p.is_file()} == earlier
    assert len(earlier) == 6


def test_a_result_that_was_replaced_in_part_has_no_document(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    common = "match", pair.left, pair.right, "-o", tmp_path, *pair.regions
    assert run(*common).code == 0
    replace, done = os.replace, list[str]()

    def full(source: str, target: str) -> None:
        if len(done) == 8:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done.append(target)
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    check_refused(run(*common, "--seed", 7), "the disk is full")
    assert not (tmp_path / "matches.json").exists()


def modes(rgb: Any) -> dict[str, PIL.Image.Image]:
    """The picture in every form that works with a note, and the word that the note has."""
    picture = PIL.Image.fromarray(rgb)
    deep = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.uint16) * 200
    return {
        "alpha": picture.convert("RGBA"),
        "CMYK": picture.convert("CMYK"),
        "16-bit": PIL.Image.fromarray(deep),
        "palette": picture.quantize(200),
        "": picture.convert("L"),
    }


@pytest.mark.parametrize("word", ["alpha", "CMYK", "16-bit", "palette", ""])
def test_other_kinds_of_pictures_work_with_one_note(run: Run, pair: Pair, tmp_path: Path, word: str) -> None:
    for name, rgb in (("left", pair.scene.left), ("right", pair.scene.right)):
        modes(rgb)[word].save(tmp_path / f"{name}.tif")
    outcome = run("match", tmp_path / "left.tif", tmp_path / "right.tif", "-o", tmp_path / "out", *pair.regions)
    document = json.loads((tmp_path / "out" / "matches.json").read_text())
    assert outcome.code == 0
    assert len(document["matches"]) > 30
    for side in ("left", "right"):
        notes = [w for w in document["notes"] if w.startswith(f"{side} image: ")]
        assert len(notes) == (1 if word else 0)
        assert all(word in note and note not in outcome.err for note in notes)


def test_a_photograph_matches_itself(run: Run, pair: Pair, tmp_path: Path) -> None:
    regions = ["--left-regions", pair.left_regions, "--right-regions", pair.left_regions]
    options = ["--segmenter", "precomputed", *regions, "--points", "sift"]
    outcome = run("match", pair.left, pair.left, "-o", tmp_path, *options)
    document = json.loads((tmp_path / "matches.json").read_text())
    assert outcome.code == 0
    assert all(m["left"] == m["right"] for m in document["matches"])
    assert len(document["matches"]) >= 0.95 * len(document["left"]["polygons"])
    assert np.median([m["confidence"] for m in document["matches"]]) > 0.9


def run_pair(run: Run, tmp_path: Path, *pictures: Any) -> tuple[Outcome, Any]:
    """Two arrays matched with regions that have nothing to do with each other; what was printed, and the result."""
    photographs: list[Path] = []
    regions: list[object] = []
    for name, pixels in zip(("left", "right"), pictures, strict=True):
        height, width = pixels.shape[:2]
        hills = photograph(len(name), width, height)[..., 0] / np.float32(10)
        labels = tmp_path / f"{name}_labels.png"
        PIL.Image.fromarray(np.maximum(regions_of(hills), 1)).save(labels)
        regions += [f"--{name}-regions", labels]
        photographs.append(tmp_path / f"{name}.png")
        PIL.Image.fromarray(pixels).save(photographs[-1])
    arguments = ["match", *photographs, *regions]
    outcome = run(*arguments, "-o", tmp_path / "out", "--segmenter", "precomputed", "--points", "sift")
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "out" / "overlay.png").stat().st_size > 1000
    return outcome, json.loads((tmp_path / "out" / "matches.json").read_text())


def test_two_unrelated_photographs(run: Run, tmp_path: Path) -> None:
    outcome, document = run_pair(run, tmp_path, photograph(1), photograph(2))
    check_unrelated(outcome, document)


def test_the_rendered_scene_against_another_photograph(run: Run, pair: Pair, tmp_path: Path) -> None:
    outcome, document = run_pair(run, tmp_path, pair.scene.left, photograph(3))
    check_unrelated(outcome, document)


def check_unrelated(outcome: Outcome, document: Any) -> None:
    assert "warning: the photographs may not show the same scene" in outcome.err
    assert len(document["left"]["polygons"]) > 40
    assert len(document["matches"]) <= 0.15 * len(document["left"]["polygons"])
    assert all(m["confidence"] <= 0.1 for m in document["matches"])


@pytest.mark.parametrize("values", [(0, 0), (128, 128), (255, 0)])
def test_pictures_of_nothing(run: Run, tmp_path: Path, values: tuple[int, int]) -> None:
    outcome, document = run_pair(run, tmp_path, *(np.full((80, 120, 3), v, np.uint8) for v in values))
    assert document["matches"] == []
    assert document["fundamental"] is None
    assert document["homography"] is None
    for warning in ("no fundamental matrix", "no homography", "no polygons were matched"):
        assert f"warning: {warning}" in outcome.err


def test_photographs_of_different_sizes(run: Run, pair: Pair, tmp_path: Path) -> None:
    larger = cv2.resize(pair.scene.left, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_CUBIC)
    PIL.Image.fromarray(larger).save(tmp_path / "larger.png")
    known = np.asarray(PIL.Image.open(pair.left_regions))
    regions = cv2.resize(known, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_NEAREST)
    PIL.Image.fromarray(regions).save(tmp_path / "regions.png")
    own = ["--left-regions", pair.left_regions, "--right-regions", tmp_path / "regions.png", "--points", "sift"]
    options = ["--segmenter", "precomputed", *own]
    assert run("match", pair.left, tmp_path / "larger.png", "-o", tmp_path, *options).code == 0
    document = json.loads((tmp_path / "matches.json").read_text())
    assert (document["left"]["width"], document["right"]["width"]) == (400, 600)
    assert len(document["matches"]) > 0.9 * len(document["left"]["polygons"])
    assert all(m["left"] == m["right"] for m in document["matches"])
    assert np.allclose(np.diag(document["homography"]), [1.5, 1.5, 1], atol=0.02)


def test_the_smallest_photographs(run: Run, tmp_path: Path) -> None:
    run_pair(run, tmp_path, photograph(1, 32, 32), photograph(2, 400, 33))
