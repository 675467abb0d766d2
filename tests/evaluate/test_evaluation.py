"""An evaluation by one call."""

import json
from pathlib import Path

import pytest
from rendered import Pair

from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError
from zpm2.evaluate import Evaluation
from zpm2.evaluate.run import file_names

SIFT = assign(preset("default"), ["points.methods=sift", "device=cpu"])


@pytest.fixture
def data(pair: Pair, tmp_path: Path) -> Path:
    pairs = [{"name": name, "left": str(pair.left), "right": str(pair.right), "gt": None} for name in "ab"]
    (tmp_path / "pairs.json").write_text(json.dumps(pairs))
    return tmp_path


@pytest.fixture(autouse=True)
def _known_regions(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    from zpm2 import api
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    real = api.Matcher
    monkeypatch.setattr("zpm2.api.Matcher", lambda config, **named: real(config, **{**named, "segmenter": own}))


def test_rows_and_files(data: Path, tmp_path: Path) -> None:
    told: list[str] = []
    evaluation = Evaluation("pairs", data, limit=1, config=SIFT)
    (row,) = evaluation.run(tmp_path / "out", tell=told.append)
    assert (row["pair"], row["status"]) == ("a", "ok")
    assert told == ["matched 1 of 1: a", "scored 1 of 1: a"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {".zpm2", *file_names()}
    assert evaluation.published([row]) == ""
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["title"] == "pairs, zpm2"
    told.clear()
    assert evaluation.run(tmp_path / "out", score_only=True, tell=told.append)[0]["matches"] == row["matches"]
    assert told == ["scored 1 of 1: a"]


def test_what_cannot_be_used(data: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unknown method 'sift'; methods are: zpm2"):
        Evaluation("pairs", data, method="sift").run(tmp_path / "out")
    with pytest.raises(InputError, match="holds no predictions"):
        Evaluation("pairs", data).run(tmp_path / "out", score_only=True)
    assert not (tmp_path / "out").exists()
