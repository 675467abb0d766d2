"""The whole method with the real pre-trained models, on a rendered scene whose truth is known exactly."""

import json
from pathlib import Path

import pytest
from rendered import Pair, Run

from zpm2 import MatchResult
from zpm2.config import assign, preset
from zpm2.evaluate.rendered import score_on_disparity
from zpm2.pipeline import PairMatcher

pytestmark = pytest.mark.weights

SETTINGS = ["segment.grid=6", "points.max_keypoints=1000", "device=cpu"]


def test_a_rendered_pair_with_the_real_models(run: Run, pair: Pair, tmp_path: Path) -> None:
    """Once by the command line, once by the Python API: right matches, and the same bytes but for the times."""
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    code, out, err = run("match", pair.left, pair.right, "-o", tmp_path, "--preset", "paper", *settings, "--json")
    assert code == 0, err
    result = MatchResult.load(tmp_path)
    truth = score_on_disparity(result.left.polygons, result.right.polygons, result.matches, pair.scene.disparity)
    assert truth.good >= 12
    assert truth.precision >= 0.8
    assert truth.coverage >= 0.5
    assert len(result.points) > 200
    assert json.loads(out)["matches"] == len(result.matches)

    again = PairMatcher(assign(preset("paper"), SETTINGS))(pair.left, pair.right)
    first, second = ({**r.to_dict(), "timings": None} for r in (result, again))
    assert json.dumps(first) == json.dumps(second)
