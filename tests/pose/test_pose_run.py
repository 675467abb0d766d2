"""A pose by one call."""

import json
from pathlib import Path

import numpy as np
import pytest
from rendered import Pair

import zpm2
from zpm2.api import Matcher
from zpm2.config import assign, preset
from zpm2.errors import ConfigError, Failed
from zpm2.pose.run import check_colmap, file_names, read_cameras
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter

SIFT = assign(preset("default"), ["points.methods=sift", "device=cpu", "pose.crops=off"])


@pytest.fixture(scope="module")
def matches(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    return Matcher(SIFT, segmenter=own)(pair.left, pair.right).save(tmp_path_factory.mktemp("matches"))


def k(pair: Pair) -> str:
    return f"{pair.scene.f},{pair.scene.f},{pair.scene.cx},{pair.scene.cy}"


def test_find_and_save(pair: Pair, matches: Path, tmp_path: Path) -> None:
    found = zpm2.pose.find(str(pair.left), pair.right, SIFT, k=k(pair), baseline=0.2, matches=matches)
    assert not isinstance(found.pose.pose, Failed)
    assert np.allclose(found.pose.translation, [-0.2, 0, 0], atol=0.01)
    assert len(found.matches.matches) > 20
    saved = found.save(tmp_path, rectified=True)
    assert saved == ([tmp_path / "pose.json", tmp_path / "rectified"], [])
    assert sorted(path.name for path in saved.written[1].iterdir()) == [
        *("left.geojson", "left.png", "rectification.json", "right.geojson", "right.png"),
    ]
    assert set(file_names(rectified=True)) == {path.name for path in tmp_path.iterdir()} - {".zpm2"}
    found.save(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} - {".zpm2"} == {"pose.json"}


def test_new_matches_are_handed_over_before_the_pose(
    pair: Pair, matches: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []
    monkeypatch.setattr("zpm2.api.Matcher.__call__", lambda *_: MatchResult.load(matches))
    monkeypatch.setattr("zpm2.pose.run.PoseFinder.__call__", lambda *_: told.append("pose") or Failed("not asked"))
    zpm2.pose.find(pair.left, pair.right, SIFT, k=k(pair), matched=lambda result: told.append(len(result.matches) > 20))
    assert told == [True, "pose"]


def test_without_a_pose_nothing_is_rectified(pair: Pair, matches: Path, tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    found = zpm2.pose.find(pair.left, pair.right, SIFT, matches=matches)  # no EXIF, and the pair is rectified
    assert isinstance(found.pose.pose, Failed)
    written, missing = found.save(tmp_path, rectified=True, as_colmap=True)
    assert written == [tmp_path / "pose.json"]
    assert json.loads(written[0].read_text())["pose"] is None
    assert [text.partition(":")[0] for text in missing] == ["not rectified", "no COLMAP model"]


def test_what_cannot_be_used(pair: Pair, matches: Path) -> None:
    with pytest.raises(ConfigError, match="length above 0"):
        zpm2.pose.find(pair.left, pair.right, SIFT, baseline=-1.0)
    with pytest.raises(ConfigError, match="the other way round"):
        zpm2.pose.find(pair.right, pair.left, SIFT, k=k(pair), matches=matches)
    with pytest.raises(ConfigError, match="--K2 without --K"):
        read_cameras((pair.left, pair.right), [(400, 240)] * 2, (None, "guess"))
    with pytest.raises(ConfigError, match="400 x 240 and 200 x 240 px: give --K2"):
        read_cameras((pair.left, pair.right), [(400, 240), (200, 240)], (k(pair), None))
    pytest.importorskip("pycolmap")
    with pytest.raises(ConfigError, match="is given twice"):
        check_colmap(pair.left, pair.left)
