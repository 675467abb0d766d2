import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import fundamental, turn

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match import initial_geometry
from zpm2.model import PointMatches

CONFIG = GlobalConfig()
TRUTH = turn(4, 1.05, np.array([320.0, 240.0]), (-15.0, 6.0))
EPIPOLAR = fundamental(TRUTH)
PLANE, OFF_PLANE, WRONG = 80, 40, 20


def points(seed):
    """Points of a plane, points off it (consistent with F, not with H), and mismatches."""
    rng = np.random.default_rng(seed)
    left = rng.uniform((30, 30), (610, 450), (PLANE + OFF_PLANE + WRONG, 2))
    right = geometry.project(TRUTH, left)
    along = geometry.epipolar_lines(EPIPOLAR, left)[:, [1, 0]] * [1, -1]
    normal = geometry.epipolar_lines(EPIPOLAR, left)[:, :2]
    off, wrong = slice(PLANE, PLANE + OFF_PLANE), slice(PLANE + OFF_PLANE, None)
    right[off] += along[off] * rng.uniform(20, 60, (OFF_PLANE, 1))
    right[wrong] += normal[wrong] * rng.uniform(30, 90, (WRONG, 1))
    order = rng.permutation(len(left))
    kind = np.repeat([0, 1, 2], [PLANE, OFF_PLANE, WRONG])[order]
    return PointMatches(left[order], right[order], np.ones(len(left))), kind


@given(st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_each_kind_of_point_is_told_apart_and_all_are_kept(seed):
    matches, kind = points(seed)
    initial = initial_geometry(matches, CONFIG, 0)
    assert initial.points is matches
    assert initial.consistent[kind < 2].all()
    assert not initial.consistent[kind == 2].any()
    assert initial.planar[kind == 0].all()
    assert not initial.planar[kind > 0].any()
    assert geometry.project(initial.homography, matches.left[kind == 0]) == pytest.approx(
        matches.right[kind == 0], abs=0.05
    )


def test_the_same_seed_gives_the_same_bytes():
    matches, _ = points(5)
    one, two = (initial_geometry(matches, CONFIG, 3) for _ in range(2))
    assert one.fundamental.tobytes() == two.fundamental.tobytes()
    assert one.homography.tobytes() == two.homography.tobytes()


@pytest.mark.parametrize("count", [0, 3, 5])
def test_too_few_points_fail_with_a_reason(count):
    matches, kind = points(0)
    few = matches[np.flatnonzero(kind == 0)[:count]]
    initial = initial_geometry(few, CONFIG, 0)
    assert isinstance(initial.fundamental, Failed)
    assert isinstance(initial.homography, Failed)
    assert str(count) in initial.fundamental.reason
    assert str(count) in initial.homography.reason
    assert initial.consistent.shape == initial.planar.shape == (count,)
    assert initial.consistent.all()
    assert not initial.planar.any()


def test_without_f_a_homography_is_tried_on_all_points():
    matches, kind = points(1)
    initial = initial_geometry(matches[np.flatnonzero(kind == 0)[:7]], CONFIG, 0)
    assert isinstance(initial.fundamental, Failed)
    assert initial.planar.all()
    assert initial.homography == pytest.approx(TRUTH, abs=1e-3 * np.abs(TRUTH).max())


def test_unrelated_points_leave_nothing_planar():
    rng = np.random.default_rng(2)
    matches = PointMatches(rng.uniform(0, 500, (60, 2)), rng.uniform(0, 500, (60, 2)), np.ones(60))
    initial = initial_geometry(matches, CONFIG, 0)
    assert initial.planar.sum() < 15
    assert not initial.planar[~initial.consistent].any()
