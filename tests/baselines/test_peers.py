"""The methods that use points, in whole runs on a rendered pair."""

import dataclasses

import numpy as np
import pytest
from rendered import Pair, Run

from zpm2 import MatchResult
from zpm2.baselines import METHODS, BaselineMatcher
from zpm2.config import Config, PointsConfig
from zpm2.segment.given.precomputed import PrecomputedSegmenter

CONFIG = Config(points=PointsConfig(methods=("sift",)), device="cpu")


class Seen:
    """Regions from a file, on a photograph whose embedding is its colours."""

    name = "seen"
    embedding_scale = 0.25

    def __init__(self, regions, min_area=200):
        self.regions = PrecomputedSegmenter(regions, min_area=min_area)

    def segment(self, image):
        return self.regions.segment(image)

    def polygons(self, image):
        return self.regions.polygons(image)

    def view(self, image):
        return Colours(image)


class Colours:
    """A photograph's own colours, and where they lie, as its embedding."""

    embedding_scale = 0.25

    def __init__(self, image):
        self.image = image

    def embedding(self):
        small = self.image.rgb[2::4, 2::4].astype(np.float32) / 255
        at = np.indices(small.shape[:2]) / np.array(small.shape[:2])[:, None, None]
        return np.concatenate([small.transpose(2, 0, 1), at.astype(np.float32)])


@pytest.mark.parametrize("name", ["vote", "masa", "sgam", "mesa"])
def test_a_rendered_pair(pair: Pair, tmp_path, name):
    segmenters = Seen(pair.left_regions), Seen(pair.right_regions)
    matcher = BaselineMatcher(name, CONFIG, segmenter=segmenters)
    result = matcher(pair.left, pair.right)
    right = sum(m.left == m.right for m in result.matches)
    assert right > 0.8 * len(result.matches)
    assert len(result.matches) > (5 if name == "masa" else 15)
    assert any(note.startswith(f"{name} is ") for note in result.notes)
    fields = {item.name: getattr(METHODS[name], item.name) for item in dataclasses.fields(METHODS[name])}
    assert result.config["baseline"] == {"method": name, **fields}
    assert (len(result.points) > 0) == METHODS[name].uses_points == ("points" in result.timings)
    if METHODS[name].uses_points:
        assert max(m.dsf for m in result.matches) > 10
    again = BaselineMatcher(name, CONFIG, segmenter=segmenters)(pair.left, pair.right)
    assert again.to_dict() | {"timings": 0} == result.to_dict() | {"timings": 0}
    loaded = MatchResult.load(result.save(tmp_path / "out"))
    assert [(m.left, m.right, m.cost) for m in loaded.matches] == [(m.left, m.right, m.cost) for m in result.matches]


@pytest.mark.parametrize("name", ["vote", "mesa"])
def test_the_command_line(pair: Pair, run: Run, tmp_path, name):
    code, out, err = run("match", pair.left, pair.right, "-o", tmp_path / "out", "--method", name, *pair.regions)
    assert code == 0, err
    assert "matches" in out
    assert MatchResult.load(tmp_path / "out").config["baseline"]["method"] == name


def test_points_that_do_not_exist_are_refused_before_anything_is_loaded(pair: Pair, run: Run, tmp_path):
    words = ["--method", "vote", "--points", "siftt"]
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path / "out", *words)
    assert code == 2
    assert "unknown point method 'siftt' (did you mean 'sift'?)" in err
