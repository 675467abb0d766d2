"""`zpm2 carry` on the demo's pair, without weights: the classical segmenter, and SIFT's points."""

import json

import numpy as np
import PIL.Image
import pytest

from zpm2 import api, config
from zpm2.carry.run import _prompted
from zpm2.cli import app
from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.rendered import render_scene
from zpm2.evaluate.rendered.files import save_scene

SETTINGS = ["points.escalate.on=false", "segment.model=classical", "points.methods=sift"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    save_scene(render_scene(0, 400, 300), folder)
    return folder


def carry(monkeypatch, *words):
    """The exit code of the command."""
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    monkeypatch.setattr("sys.argv", ["zpm2", "carry", *map(str, words), *settings])
    with pytest.raises(SystemExit) as done:
        app.main()
    return done.value.code


def labels(path):
    return np.asarray(PIL.Image.open(path))


def test_a_label_image_comes_back_with_the_same_numbers(demo, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    words = demo / "left.png", demo / "right.png", "--regions", demo / "left_labels.png", "-o", out
    assert carry(monkeypatch, *words) == 0
    folder, given, truth = out / "right", labels(demo / "left_labels.png"), labels(demo / "right_labels.png")
    found = labels(folder / "regions.png")
    assert found.shape == truth.shape
    assert found.dtype == given.dtype
    numbers = set(np.unique(given)) - {0}
    assert set(np.unique(found)) - {0} <= numbers
    document = json.loads((folder / "carry.json").read_text())
    assert document["schema"] == "zpm2-carry/1"
    assert len(document["regions"]) == len(numbers)
    assert all(region["status"] and region["reason"] for region in document["regions"])
    right = [np.mean(truth[found == n] == n) for n in np.unique(found) if n]
    assert len(right) >= 5
    assert np.median(right) > 0.8  # most of what carries a number shows that surface
    assert (folder / "overlay.png").exists()
    assert "regions: " in capsys.readouterr().out


def test_several_photographs_and_the_rigid_way(demo, tmp_path, monkeypatch):
    out = tmp_path / "out"
    words = demo / "left.png", demo / "right.png", demo / "left.png", "--regions", demo / "left_labels.png", "-o", out
    assert carry(monkeypatch, *words, "--rigid", "--quiet") == 0
    assert sorted(path.name for path in out.iterdir() if path.name[0] != ".") == ["left", "right"]
    given, same = labels(demo / "left_labels.png"), labels(out / "left" / "regions.png")
    assert np.mean(given == same) > 0.97  # in the photograph itself nothing moves


def test_masks_for_other_programs(demo, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    words = demo / "left.png", demo / "right.png", "--regions", demo / "left_labels.png", "-o", out, "--rigid"
    options = "--masks", "colmap", "--masks", "openmvs", "--mask-regions", "remove"
    assert carry(monkeypatch, *words, *options, "--quiet") == 0
    given = labels(demo / "left_labels.png")
    assert np.mean((labels(out / "masks" / "colmap" / "left.png.png") == 0) == (given > 0)) > 0.99
    right = labels(out / "masks" / "openmvs" / "right.mask.png")
    assert ((right == 0) == (labels(out / "right" / "regions.png") > 0)).mean() > 0.99
    assert carry(monkeypatch, *words, "--masks", "metashape") == 2
    assert "there are: colmap, openmvs, nerfstudio" in capsys.readouterr().err
    assert carry(monkeypatch, *words, "--masks", "colmap", "--mask-regions", "hide") == 2
    assert "give keep or remove" in capsys.readouterr().err


def test_a_second_run_replaces_its_own_files_only(demo, tmp_path, monkeypatch):
    out = tmp_path / "out"
    words = demo / "left.png", demo / "right.png", "--regions", demo / "left_labels.png", "-o", out, "--rigid"
    assert carry(monkeypatch, *words, "--quiet") == 0
    first = (out / "right" / "regions.png").read_bytes()
    (out / "right" / "mine.txt").write_text("mine")
    assert carry(monkeypatch, *words, "--quiet") == 0
    assert (out / "right" / "regions.png").read_bytes() == first
    assert (out / "right" / "mine.txt").read_text() == "mine"


def test_misuse_is_one_line(demo, tmp_path, monkeypatch, capsys):
    words = demo / "left.png", demo / "right.png", "-o", tmp_path / "out", "--regions"
    assert carry(monkeypatch, *words, tmp_path / "none.json") == 2
    assert "does not exist" in capsys.readouterr().err
    assert carry(monkeypatch, *words, demo / "left.png") == 2  # a photograph is no label image
    assert len(capsys.readouterr().err.splitlines()) == 1
    (tmp_path / "far.txt").write_text("0 1.2 1.2 1.4 1.2 1.4 1.4")  # YOLO's shares: beside the photograph
    assert carry(monkeypatch, *words, tmp_path / "far.txt", "--rigid", "--quiet") == 2
    assert "far.txt has no region with an area in the 400 x 300 px left photograph" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_polygons_from_python(demo):
    matcher = api.Matcher(config.assign(config.preset("default"), SETTINGS))
    result = api.match(demo / "left.png", demo / "right.png", matcher.config)
    carried = matcher.carry(demo / "left.png", demo / "right.png", result.left.polygons)
    assert len(carried.outcomes) == len(result.left.polygons)
    assert carried.counts()["found"] >= 1


def test_a_segmenter_without_prompts_is_refused(demo):
    with pytest.raises(ConfigError, match="takes no prompts"):
        _prompted(object(), config.preset("default"))


def test_an_empty_file_is_refused(demo, tmp_path):
    (tmp_path / "none.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(InputError, match="no region"):
        api.Matcher(config.assign(config.preset("default"), SETTINGS)).carry(
            demo / "left.png", demo / "right.png", tmp_path / "none.geojson"
        )
