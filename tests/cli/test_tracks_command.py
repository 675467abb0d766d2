"""`zpm2 tracks` as people type it."""

import json
from pathlib import Path

import numpy as np
import PIL.Image
import wall
from rendered import Run

SETTINGS = [word for setting in wall.SETTINGS for word in ("--set", setting)]


def test_a_folder(run: Run, tmp_path: Path) -> None:
    (tmp_path / "photographs").mkdir()
    wall.save_photographs(tmp_path / "photographs", 2)
    words = ("tracks", tmp_path / "photographs", "-o", tmp_path / "out", "--pairs", "sequential", *SETTINGS)
    code, out, err = run(*words, "--sheets", 1)
    assert code == 0, err
    assert "tracks in 2 photographs" in out
    first = (tmp_path / "out" / "tracks.json").read_bytes()
    assert len(list((tmp_path / "out" / "sheets").iterdir())) == 1
    code, out, _ = run(*words, "--json", "--masks", "colmap", "--mask-regions", "remove")
    summary = json.loads(out)
    assert summary["tracks"] == len(json.loads(first)["tracks"])
    assert (tmp_path / "out" / "tracks.json").read_bytes() == first
    for photograph in (tmp_path / "photographs").iterdir():
        labels = np.asarray(PIL.Image.open(tmp_path / "out" / "labels" / f"{photograph.stem}.png"))
        mask = np.asarray(PIL.Image.open(tmp_path / "out" / "masks" / "colmap" / f"{photograph.name}.png"))
        assert np.array_equal(mask == 0, labels > 0)


def test_misuse_is_one_line(run: Run, tmp_path: Path) -> None:
    rng, folder = np.random.default_rng(0), tmp_path / "photographs"
    folder.mkdir()
    for name in ("a.png", "b.png"):
        PIL.Image.fromarray(rng.integers(0, 255, (48, 64, 3), np.uint8)).save(folder / name)
    for words, said in (
        ([folder / "a.png"], "1 photograph given"),
        ([folder / "a.png", folder / "a.png"], "the same photograph"),
        ([folder, "--pairs", "nearest"], "--pairs nearest: give one of"),
        ([folder, "--pairs", "colmap"], "no database.db"),
        ([tmp_path / "none", folder / "a.png"], "none"),
        ([folder], "no pair of photographs to match (auto, by points)"),
        ([folder, "--set", "tracks.same=0"], "tracks.same must be above 0"),
    ):
        code, _, err = run("tracks", *words, "-o", tmp_path / "out", *SETTINGS)
        assert code == 2, words
        assert said in err
        assert len(err.splitlines()) == 1
        assert not (tmp_path / "out").exists()


def test_no_tracks_is_exit_code_1(run: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        PIL.Image.fromarray(rng.integers(0, 255, (48, 64, 3), np.uint8)).save(tmp_path / name)
    words = (tmp_path / "a.png", tmp_path / "b.png", "--pairs", "exhaustive", "-o", tmp_path / "out", *SETTINGS)
    code, _, err = run("tracks", *words)
    assert code == 1
    assert "no region was followed" in err
    assert json.loads((tmp_path / "out" / "tracks.json").read_text())["tracks"] == []
