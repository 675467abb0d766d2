"""SGAM: what looks alike is a candidate, geometry decides."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from region_pairs import found, grid, points, region_pair, squares

from zpm2.baselines import Sgam
from zpm2.baselines.sgam import candidates, mixed


def test_candidates_are_the_best_of_both_and_those_close_to_it():
    similarity = np.array([[0.9, 0.85, 0.1], [0.2, 0.88, 0.1], [0.0, 0.1, 0.25]])
    rows, doubtful = candidates(similarity, least=0.3, doubt=0.1)
    assert rows.tolist() == [[0, 0], [0, 1], [1, 1]]
    assert doubtful.tolist() == [True, True, True]
    rows, doubtful = candidates(similarity, least=0.2, doubt=0.01)
    assert rows.tolist() == [[0, 0], [1, 1], [2, 2]]
    assert not doubtful.any()


def look(*kinds):
    """Embeddings of regions of some kinds, the same inside and around."""
    return np.eye(5)[list(kinds)]


def plane(xy):
    """Where a camera that moved to the left sees points at several depths."""
    x, y = np.asarray(xy, float).T
    return np.c_[x + 7 + y % 13 / 2, y]


def test_twins_are_told_apart_by_their_points():
    """Two regions look the same; the points say which is which."""
    boxes = (0, 0, 60), (100, 0, 60), (0, 100, 90)
    left = np.concatenate([grid(*box, 5) for box in boxes])
    matches = points(left, plane(left))
    right = squares(*((x + 8, y, side) for x, y, side in boxes))
    pair = region_pair(squares(*boxes), right[::-1], matches, lambda shapes: (look(0, 0, 1), look(1, 0, 0)))
    assert set(found(Sgam(), pair)) == {(0, 2), (1, 1), (2, 0)}
    # without points nothing can be said
    assert not found(Sgam(), region_pair(squares(*boxes), right, embed=lambda shapes: (look(0, 0, 1), look(0, 0, 1))))


def test_what_looks_different_is_no_candidate():
    left = grid(0, 0, 60, 5)
    matches = points(left, plane(left))
    pair = region_pair(squares((0, 0, 60)), squares((8, 0, 60)), matches, lambda shapes: (look(0), look(1)))
    assert not found(Sgam(), pair)
    assert not found(Sgam(), region_pair([], squares((0, 0, 9))))


def test_the_rejector_drops_what_contradicts_the_geometry_of_the_others():
    rng = np.random.default_rng(2)
    boxes = (0, 0, 90), (100, 0, 60)
    good, bad = rng.uniform(0, 90, (80, 2)), rng.uniform((100, 0), (160, 60), (30, 2))
    disparity = np.c_[rng.uniform(3, 9, 80), np.zeros(80)]
    matches = points([*good, *bad], [*(good + disparity), *rng.permutation(bad)])
    right = squares((0, 0, 100), (100, 0, 60))
    pair = region_pair(squares(*boxes), right, matches, lambda shapes: (look(0, 1), look(0, 1)))
    assert set(found(Sgam(phi=1.0), pair)) == {(0, 0)}
    assert set(found(Sgam(phi=1e6), pair)) == {(0, 0), (1, 1)}


@given(st.floats(0, 10), st.floats(0, 1), st.floats(0.1, 9))
def test_inconsistency_stays_within_its_limit(own, leaving, limit):
    """Else a confidence is below 0 by rounding, and no picture can be drawn."""
    found = mixed(np.array([own]), np.array([leaving]), limit)[0]
    assert 0 <= found <= limit
    assert np.isclose(found, (1 - leaving) * min(own, limit) + leaving * limit)
