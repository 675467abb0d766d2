"""Weights of point matchers whose hash zpm2 does not know: every result says so."""

import pytest
from rendered import Pair

from zpm2 import match
from zpm2.config import PointsConfig
from zpm2.features import weights_notes
from zpm2.model.messages import Note

COPY = "zpm2 does not know the hash of loftr_outdoor.ckpt: your copy was taken as it is"


def test_a_copy_of_the_user_is_noted(tmp_path, monkeypatch):
    monkeypatch.setenv("ZPM2_WEIGHTS", str(tmp_path))
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "cache"))
    config = PointsConfig(methods=("loftr-outdoor", "sift", "xfeat"))
    assert weights_notes(config) == []
    (tmp_path / "loftr_outdoor.ckpt").write_bytes(b"whatever")
    assert weights_notes(config) == [COPY]
    assert isinstance(weights_notes(config)[0], Note)


@pytest.mark.parametrize(
    ("module", "options"),
    [
        ("pipeline", {}),
        ("tiled.run", {"tiles": "on"}),
        ("baselines.matcher", {"method": "vote"}),
    ],
)
def test_every_way_to_match_says_it(pair: Pair, monkeypatch, module, options):
    monkeypatch.setattr(f"zpm2.{module}.weights_notes", lambda config: [Note(COPY)])
    regions = {"left_regions": pair.left_regions, "right_regions": pair.right_regions}
    found = match(pair.left, pair.right, points="sift", device="cpu", **regions, **options)
    assert COPY in found.notes
    assert COPY not in found.warnings
