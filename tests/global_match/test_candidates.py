import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.config import GlobalConfig
from zpm2.global_match import Candidates, PriorLocations, PyramidLocations, search_candidates
from zpm2.model import Polygon, PolygonArrays

CONFIG = GlobalConfig()


def boxes(centers, sides):
    unit = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return PolygonArrays([Polygon(10 + k, c + unit * s) for k, (c, s) in enumerate(zip(centers, sides, strict=True))])


def at(centers):
    n, centers = len(centers), np.asarray(centers, float)
    expected = PriorLocations(centers, np.tile(np.eye(2), (n, 1, 1)))
    return PyramidLocations(centers, np.ones(n, bool), np.ones(n), np.zeros(n, bool), expected)


@given(st.integers(0, 10**6), st.sampled_from(["pyramid", "fixed"]))
@settings(max_examples=30, deadline=None)
def test_polygons_that_meet_the_final_window(seed, search):
    rng = np.random.default_rng(seed)
    left = boxes(rng.uniform(0, 300, (9, 2)), rng.uniform(5, 60, (9, 2)))
    right = boxes(rng.uniform(0, 300, (12, 2)), rng.uniform(5, 60, (12, 2)))
    places = rng.uniform(0, 300, (9, 2))
    places[4] = np.nan
    found = search_candidates(left, right, at(places), dataclasses.replace(CONFIG, search=search))
    expected = []
    for i, (x, y) in enumerate(places):
        width, height = left.bounds[i, 2:] - left.bounds[i, :2]
        r = CONFIG.phi / 2 if search == "pyramid" else min(width, height)
        expected += [
            (i, j)
            for j, s in enumerate(right.shapes)
            if i != 4 and s.intersects(shapely.box(x - r, y - r, x + r, y + r))
        ]
    assert list(zip(found.left.tolist(), found.right.tolist(), strict=True)) == expected


def test_no_polygons_no_candidates():
    none = PolygonArrays([])
    one = boxes([[5, 5]], [[4, 4]])
    assert len(search_candidates(none, one, at(np.zeros((0, 2))), CONFIG)) == 0
    assert len(search_candidates(one, none, at([[5, 5]]), CONFIG)) == 0
    assert len(search_candidates(one, one, at([[np.nan, np.nan]]), CONFIG)) == 0


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6))), st.integers(0, 6))
def test_a_candidate_relation_is_a_sorted_set(some, row):
    def listed(candidates):
        return list(zip(candidates.left.tolist(), candidates.right.tolist(), strict=True))

    rows = np.array(some, np.int64).reshape(-1, 2)
    candidates = Candidates.of(rows[:, 0], rows[:, 1])
    assert len(candidates) == len(set(some))
    assert listed(candidates) == sorted(set(some))
    assert listed(candidates[np.flatnonzero(candidates.left == row)]) == sorted(p for p in set(some) if p[0] == row)


@pytest.mark.parametrize("side", [5, 10, 20])
def test_candidates_grow_with_the_polygons_not_with_their_square(side):
    centers = 40.0 * np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    polygons = boxes(centers, np.full((side**2, 2), 36.0))
    jitter = np.random.default_rng(0).uniform(-20, 20, centers.shape)
    assert side**2 <= len(search_candidates(polygons, polygons, at(centers + jitter), CONFIG)) <= 4 * side**2
