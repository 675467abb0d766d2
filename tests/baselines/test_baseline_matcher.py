"""The baselines as matchers: whole runs, one-to-one, odd outlines, and what the result says."""

from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered import Pair
from rings import generators, star

from zpm2 import MatchResult
from zpm2.baselines import BaselineMatcher, ShapeContext
from zpm2.baselines.outlines import one_to_one
from zpm2.config import Config, PointsConfig
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.model import Polygon
from zpm2.pipeline import PairMatcher
from zpm2.segment.given.precomputed import PrecomputedSegmenter

BLANK = np.full((200, 300, 3), 90, np.uint8)

ODD = {
    "triangle": [[10, 10], [60, 10], [30, 50]],
    "sliver": [[10, 10], [90, 10.001], [90, 10.002]],
    "needle in a square": [[10, 10], [50, 10], [50, 49.99], [200, 50], [50, 50.01], [50, 60], [10, 60]],
    "repeated vertices": [[10, 10], [10, 10], [60, 10], [60, 10], [60, 40], [10, 40], [10, 10]],
    "vertices in line": [[10, 10], [20, 10], [30, 10], [60, 10], [60, 40], [10, 40], [10, 20]],
    "spiral": [
        *[[0, 0], [90, 0], [90, 90], [20, 90], [20, 30], [60, 30], [60, 60], [40, 60], [40, 50], [50, 50]],
        *[[50, 40], [30, 40], [30, 80], [80, 80], [80, 10], [0, 10]],
    ],
    "far away": [[1e6, 1e6], [1e6 + 40, 1e6], [1e6 + 30, 1e6 + 20], [1e6, 1e6 + 30]],
}


class Given:
    """A segmenter that knows the polygons."""

    name = "given"

    def __init__(self, polygons):
        self.known = polygons

    def segment(self, image):
        raise AssertionError("polygons are asked for as polygons")

    def polygons(self, image):
        return self.known


def run(method, left, right, **options):
    return BaselineMatcher(method, segmenter=(Given(left), Given(right)), **options)(BLANK, BLANK)


@pytest.fixture(params=["shape-context", "idsc"])
def method(request):
    return request.param


def test_the_same_polygons_in_another_order_are_all_found(method):
    rng = np.random.default_rng(5)
    rings = [star(rng, int(n), (100, 100), 50) for n in rng.integers(5, 40, 15)]
    order = rng.permutation(15)
    left = [Polygon(100 + k, ring) for k, ring in enumerate(rings)]
    right = [Polygon(int(k), 0.6 * rings[k] + [40, -20]) for k in order]
    told = []
    result = run(method, left, right, progress=lambda stage, share: told.append((stage, share)))
    assert [(m.left, m.right) for m in result.matches] == [(100 + k, k) for k in range(15)]
    assert all(m.cost < 2e-3 and m.confidence > 0.98 for m in result.matches)
    assert all((m.dsf, m.stage, m.overlap) == (0, "global", 0.0) for m in result.matches)
    assert list(result.timings) == ["read", "load", "detect", "describe", "compare"]
    assert all(seconds >= 0 for seconds in result.timings.values())
    assert result.warnings == []
    assert len(result.points) == 0
    for estimate in (result.fundamental, result.homography):
        assert estimate == Failed("not estimated by this method")
    assert result.config["baseline"]["method"] == method
    shares = [share for stage, share in told if stage == "compare"]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0, 1)


def test_different_shapes_stay_unmatched(method):
    square = np.array([[0, 0], [50, 0], [50, 50], [0, 50]], float)
    comb = [[0, 0], [90, 0]] + [[x, y] for k in range(8, -1, -1) for x, y in [(10 * k + 9, 60), (10 * k + 5, 5)]]
    result = run(method, [Polygon(0, square)], [Polygon(0, np.array(comb, float))])
    assert not result.matches
    assert result.warnings == ["no polygons were matched"]


def test_nothing_on_one_side(method):
    result = run(method, [Polygon(0, np.array(ODD["triangle"], float))], [])
    assert not result.matches
    assert result.warnings == ["no regions were found in the right image", "no polygons were matched"]


def test_odd_outlines_find_themselves(method):
    polygons = [Polygon(k, np.array(ring, float)) for k, ring in enumerate(ODD.values())]
    result = run(method, polygons, polygons[::-1])
    assert {(m.left, m.right) for m in result.matches} >= {(k, k) for k in (0, 1, 2, 5, 6)}
    assert all(np.isfinite(m.cost) and m.cost < 2e-3 for m in result.matches)
    assert len(result.matches) == len(polygons)


def test_an_image_pair_from_files(method, pair: Pair, tmp_path):
    segmenters = tuple(PrecomputedSegmenter(path, min_area=2000) for path in (pair.left_regions, pair.right_regions))
    config = Config(points=PointsConfig(methods=("sift",)), device="cpu")
    baseline = BaselineMatcher(method, config, segmenter=segmenters)
    result = baseline(pair.left, pair.right)
    ours = PairMatcher(config, segmenter=segmenters)(pair.left, pair.right)
    for side, other in ((result.left, ours.left), (result.right, ours.right)):
        assert [p.id for p in side.polygons] == [p.id for p in other.polygons]
        assert all(np.array_equal(p.exterior, q.exterior) for p, q in zip(side.polygons, other.polygons, strict=True))
    assert result.matches
    loaded = MatchResult.load(result.save(tmp_path / "out"))
    assert [(m.left, m.right, m.cost) for m in loaded.matches] == [(m.left, m.right, m.cost) for m in result.matches]
    again = baseline(pair.left, pair.right)
    assert again.to_dict() | {"timings": 0} == result.to_dict() | {"timings": 0}


def test_settings_of_ones_own():
    rng = np.random.default_rng(5)
    left, right = ([Polygon(k, star(rng, 9)) for k in range(n)] for n in (4, 6))
    result = run(ShapeContext(samples=40, limit=1.0), left, right)
    assert len(result.matches) == 4
    recorded = {"samples": 40, "rings": 5, "sectors": 12, "rotated": False, "limit": 1.0}
    assert result.config["baseline"] == {"method": "shape-context", **recorded}


def test_misuse():
    with pytest.raises(ConfigError, match="unknown baseline 'sc'; baselines are: shape-context, idsc"):
        BaselineMatcher("sc")
    with pytest.raises(ConfigError, match="unknown preset"):
        BaselineMatcher("idsc", "fast")
    with pytest.raises(InputError, match="left image"):
        BaselineMatcher("idsc", segmenter=Given([]))("no such file.png", BLANK)


def price(pairs, distance, limit):
    """What the optimal assignment minimises, up to a constant."""
    return sum(distance[i, j] - limit for i, j in pairs)


@settings(deadline=None)
@given(generators, st.integers(0, 4), st.integers(0, 4), st.floats(0.05, 1.0))
def test_one_to_one_is_the_optimum(rng, p, q, limit):
    distance = rng.uniform(size=(p, q))
    found = one_to_one(distance, limit)
    assert len(set(found[:, 0])) == len(set(found[:, 1])) == len(found)
    assert (distance[found[:, 0], found[:, 1]] < limit).all()
    every = [
        list(zip(rows, columns, strict=True))
        for k in range(min(p, q) + 1)
        for rows in combinations(range(p), k)
        for columns in permutations(range(q), k)
    ]
    assert np.isclose(price(found, distance, limit), min(price(pairs, distance, limit) for pairs in every))
