"""A cloud by one call."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from rendered import Pair

import zpm2
from zpm2 import api
from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.stereo.rig import Rig

pytest.importorskip("trimesh")
SIFT = assign(preset("default"), ["points.methods=sift", "device=cpu"])


@pytest.fixture
def counted(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The regions are known, every third match is kept; a list of the pairs that were matched."""
    own, asked, real = (
        (PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)),
        [],
        api.Matcher,
    )

    class Counting(real):  # type: ignore[misc, valid-type]
        def __init__(self, *words: object, **named: object) -> None:
            super().__init__(*words, **{**named, "segmenter": own})

        def __call__(self, left: object, right: object) -> MatchResult:
            asked.append((left, right))
            result = super().__call__(left, right)
            return dataclasses.replace(result, matches=result.matches[::3])

    monkeypatch.setattr("zpm2.api.Matcher", Counting)
    return asked


def rig(pair: Pair) -> Rig:
    scene = pair.scene
    k = f"{scene.f},{scene.f},{scene.cx},{scene.cy}"
    return zpm2.cloud.read_rig(pair.left, str(pair.right), k=k, baseline=scene.baseline)


def test_from_stereo(pair: Pair, counted: list[object], tmp_path: Path) -> None:
    np.save(tmp_path / "d.npy", -2 * pair.scene.disparity)
    given = zpm2.cloud.DisparityFile(tmp_path / "d.npy", scale=2, sign=-1)
    cloud = zpm2.cloud.from_stereo(str(pair.left), pair.right, rig(pair), SIFT, disparity=given)
    assert len(cloud.patches) > 15
    assert cloud.config["points"]["methods"] == ("sift",)
    assert [view.name for view in cloud.views] == ["left.png", "right.png"]
    assert counted == [(pair.left, pair.right)]
    saved = api.Matcher(SIFT)(pair.left, pair.right).save(tmp_path / "out")
    again = zpm2.cloud.from_stereo(pair.left, pair.right, rig(pair), SIFT, disparity=given, matches=saved)
    assert [patch.patch.area for patch in again.patches] == pytest.approx([p.patch.area for p in cloud.patches])


def test_matches_of_each_pair_are_kept(pair: Pair, counted: list[object], tmp_path: Path) -> None:
    for number, expected in ((1, 1), (2, 1)):
        cloud = zpm2.cloud.from_stereo(pair.left, pair.right, rig(pair), SIFT, kept=tmp_path / "pairs")
        assert len(cloud.patches) > 15, number
        assert len(counted) == expected
    assert json.loads((tmp_path / "pairs" / "left-right" / "matches.json").read_text())["matches"]
    zpm2.cloud.from_stereo(pair.left, pair.right, rig(pair), assign(SIFT, ["seed=3"]), kept=tmp_path / "pairs")
    assert len(counted) == 2


def test_a_pair_whose_kept_matches_are_damaged_is_matched_again(
    pair: Pair, counted: list[object], tmp_path: Path
) -> None:
    given, said = (pair.left, pair.right, rig(pair), SIFT), list[str]()
    found = zpm2.cloud.from_stereo(*given, kept=tmp_path / "pairs")
    file = tmp_path / "pairs" / "left-right" / "matches.json"
    file.write_text(file.read_text()[:1000])
    again = zpm2.cloud.from_stereo(*given, kept=tmp_path / "pairs", say=said.append)
    assert again.to_dict()["patches"] == found.to_dict()["patches"]
    assert f"{file} cannot be read" in said[0]
    file.unlink()
    for _ in range(2):
        zpm2.cloud.from_stereo(*given, kept=tmp_path / "pairs", say=said.append)
    assert len(counted) == 3
    assert len(said) == 1


def test_non_overlapping(pair: Pair, counted: list[object]) -> None:
    cloud = zpm2.cloud.from_stereo(pair.left, pair.right, rig(pair), SIFT, non_overlapping=True)
    assert all(patch.parent is None for patch in cloud.patches)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({}, "--calib, or --K and --baseline"),
        ({"k": "300,300,200,120"}, "--calib, or --K and --baseline"),
        ({"k": "300,300,200,120", "baseline": -1.0}, "length above 0"),
        ({"calibration": "calib.txt", "baseline": 1.0}, "leave out --K, --K2 and --baseline"),
    ],
)
def test_rigs_that_are_none(pair: Pair, options: dict[str, object], why: str) -> None:
    with pytest.raises((ConfigError, InputError), match=why):
        zpm2.cloud.read_rig(pair.left, pair.right, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("values", [{"scale": 0.0}, {"scale": float("nan")}, {"sign": 2}])
def test_disparities_that_cannot_be(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=r"of d\.npy: give"):
        zpm2.cloud.DisparityFile("d.npy", **values)  # type: ignore[arg-type]


def test_a_workspace_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a folder"):
        zpm2.cloud.from_workspace(tmp_path / "nowhere")
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        zpm2.cloud.from_workspace(tmp_path, "papr")
