import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from rendered import Pair

from zpm2.config import Config, PointsConfig, SegmentConfig
from zpm2.errors import InputError
from zpm2.evaluate.speed import OTHER, TOTAL, Speed, _distinct, measure, text
from zpm2.model import Image

CONFIG = Config(points=PointsConfig(methods=("sift",)), segment=SegmentConfig(model="classical", grid=6), device="cpu")


@pytest.fixture(scope="module")
def speed(pair: Pair) -> Speed:
    return measure([(pair.left, pair.right)], CONFIG, 1, many=True, environment={"zpm2": "1"})


def test_stages_add_up_to_the_total(speed: Speed) -> None:
    (pair,) = speed.pairs
    assert pair.matches > 0
    for seconds in (pair.first, pair.warm):
        assert {"points", "detect", "local", "verify", OTHER} < set(seconds)
        assert sum(seconds.values()) == pytest.approx(2 * seconds[TOTAL])
    assert speed.pairs_per_second == pytest.approx(1 / pair.warm[TOTAL])
    assert speed.many is not None
    assert speed.many.pairs == 1


def test_a_report_is_read_back_as_it_was(speed: Speed, tmp_path: Path) -> None:
    speed.save(tmp_path / "a.json")
    assert Speed.load(tmp_path / "a.json") == speed


def test_the_text_says_where_time_goes(speed: Speed) -> None:
    told = text(speed)
    assert "zpm2 1" in told
    assert "left.png - right.png: 400 x 240" in told
    assert "by match_many" in told
    assert [line.split()[0] for line in told.splitlines() if line.startswith("  ")] == ["seconds", *speed.pairs[0].warm]


def test_a_comparison_shows_how_many_times_as_fast_it_is_now(speed: Speed) -> None:
    (pair,) = speed.pairs
    slower = dataclasses.replace(pair, warm={stage: 3 * seconds for stage, seconds in pair.warm.items()})
    before = dataclasses.replace(speed, pairs=[slower])
    (total,) = [line for line in text(speed, before).splitlines() if line.startswith("  total")]
    assert total.split()[-1] == "3.00"
    assert "another configuration" not in text(speed, before)
    assert "another configuration" in text(speed, dataclasses.replace(before, config={}))
    other = dataclasses.replace(speed, pairs=[dataclasses.replace(pair, name="a - b")])
    with pytest.raises(InputError, match="no pair in common"):
        text(speed, other)


@pytest.mark.parametrize("content", ["", "[]", "{}", json.dumps({"schema": "zpm2-speed/1", "pairs": [{}]})])
def test_other_files_are_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(InputError, match="no report of zpm2 bench"):
        Speed.load(tmp_path / "a.json")
    with pytest.raises(InputError, match="cannot be read"):
        Speed.load(tmp_path / "b.json")


def test_no_run_measures_nothing(pair: Pair) -> None:
    with pytest.raises(InputError, match="0 runs"):
        measure([(pair.left, pair.right)], CONFIG, 0)


def test_no_photograph_of_many_pairs_is_the_same() -> None:
    flat = Image(np.full((40, 60, 3), 100, np.uint8))
    pairs = list(_distinct([(flat, flat)], 3))
    assert len({left.rgb.tobytes() for left, _ in pairs}) == 3
    assert all(np.abs(left.rgb.astype(int) - 100).mean() < 5 for left, _ in pairs)
