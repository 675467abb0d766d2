import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import arrays, square, star

from zpm2.config import LocalConfig
from zpm2.errors import Failed
from zpm2.local_match.pair_map import pair_maps
from zpm2.model import PointMatches, PolygonArrays

CONFIG = LocalConfig(gamma=8)
NONE = Failed("none")
seeds = st.integers(0, 10**6)


def mapped(matrix, points):
    p = np.c_[points, np.ones(len(points))] @ matrix.T
    return p[:, :2] / p[:, 2:]


def matches(left, right):
    return PointMatches(np.asarray(left, float), np.asarray(right, float), np.ones(len(left)))


def similarity(scale, angle, shift):
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    return np.array([[c, -s, shift[0]], [s, c, shift[1]], [0, 0, 1]])


@given(seeds, st.integers(1, 5))
def test_without_points_and_homography_centroid_and_area_decide(seed, n):
    rng = np.random.default_rng(seed)
    rings = [star(rng, 9, rng.uniform(100, 900, 2), 40) for _ in range(n)]
    truth = [similarity(rng.uniform(0.5, 2), 0.0, rng.uniform(-50, 50, 2)) for _ in range(n)]
    right = [mapped(m, ring) for m, ring in zip(truth, rings, strict=True)]
    found = pair_maps(arrays(rings), arrays(right), PointMatches.empty(), NONE, CONFIG)
    assert found == pytest.approx(np.stack(truth), abs=1e-6)


@given(seeds)
def test_the_homography_says_how_a_polygon_without_points_is_turned(seed):
    rng = np.random.default_rng(seed)
    ring, truth = star(rng, 9, (300, 200), 40), similarity(1.3, 0.9, (40, -20))
    other_scale = similarity(0.7, 0.9, (900, 5))
    found = pair_maps(arrays([ring]), arrays([mapped(truth, ring)]), PointMatches.empty(), other_scale, CONFIG)[0]
    assert found == pytest.approx(truth, abs=1e-6)


@given(seeds, st.integers(10, 40))
def test_many_points_give_the_pair_a_homography_of_its_own(seed, count):
    rng = np.random.default_rng(seed)
    ring, truth = square(100, 100, 200, 180), similarity(1.1, 0.3, (30, 10))
    truth[2, :2] = rng.uniform(-2e-4, 2e-4, 2)
    inside = rng.uniform((100, 100), (200, 180), (count, 2))
    found = pair_maps(
        arrays([ring]), arrays([mapped(truth, ring)]), matches(inside, mapped(truth, inside)), truth, CONFIG
    )[0]
    assert mapped(found, ring) == pytest.approx(mapped(truth, ring), abs=0.5)


def test_few_points_move_the_homography():
    ring = square(100, 100, 200, 200)
    other = np.array([[120, 100], [250, 100], [250, 130], [220, 130], [220, 200], [120, 200]], float)
    inside = np.array([[110.0, 120], [120, 150], [130, 180]])
    found = pair_maps(arrays([ring]), arrays([other]), matches(inside, np.add(inside, (20, 0))), np.eye(3), CONFIG)[0]
    assert found == pytest.approx(similarity(1, 0, (20, 0)))


def test_enough_points_see_a_polygon_that_is_partly_hidden():
    """Its area and its centroid mislead."""
    ring, cut = square(100, 100, 200, 200), square(130, 100, 170, 200)
    inside = np.random.default_rng(0).uniform((100, 100), (138, 198), (CONFIG.gamma, 2))
    found = pair_maps(arrays([ring]), arrays([cut]), matches(inside, np.add(inside, (30, 0))), np.eye(3), CONFIG)[0]
    assert mapped(found, ring) == pytest.approx(np.add(ring, (30, 0)), abs=0.1)


def test_points_that_mislead_lose_to_the_polygons():
    ring = square(100, 100, 200, 200)
    wrong = np.array([[110.0, 110], [120, 112]])
    found = pair_maps(arrays([ring]), arrays([ring + 7]), matches(wrong, wrong + 80), np.eye(3), CONFIG)[0]
    assert found == pytest.approx(similarity(1, 0, (7, 7)))


@given(seeds, st.integers(0, 60))
def test_each_pair_is_on_its_own(seed, count):
    rng = np.random.default_rng(seed)
    lefts, rights = ([star(rng, 8, rng.uniform(50, 150, 2), 60) for _ in range(5)] for _ in range(2))
    points = matches(rng.uniform(0, 200, (count, 2)), rng.uniform(0, 200, (count, 2)))
    together = pair_maps(arrays(lefts), arrays(rights), points, NONE, CONFIG)
    assert np.isfinite(together).all()
    for k, maps in enumerate(together):
        left, right = arrays([lefts[k]]), arrays([rights[k]])
        assert maps == pytest.approx(pair_maps(left, right, points, NONE, CONFIG)[0], rel=1e-6, abs=1e-9)


def test_nothing():
    empty = PolygonArrays([])
    assert pair_maps(empty, empty, PointMatches.empty(), np.eye(3), CONFIG).shape == (0, 3, 3)


def test_a_homography_that_collapses_or_tears_is_not_used():
    ring = star(np.random.default_rng(1), 9, (300, 200), 40)
    for broken in (np.diag([1.0, 0, 1]), np.array([[1, 0, 0], [0, 1, 0], [1, 0, -300.0]])):
        found = pair_maps(arrays([ring]), arrays([ring + 5]), PointMatches.empty(), broken, CONFIG)
        assert np.isfinite(found).all()
    assert found.shape == (1, 3, 3)
