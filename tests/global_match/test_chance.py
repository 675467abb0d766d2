"""What is evidence for one scene and what is chance; and which way round an image is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import turn

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.global_match.chance import is_mirrored, log_chance, same_scene
from zpm2.model import PointMatches

CONFIG = GlobalConfig()
LIMITS = CONFIG.chance
SIZE = np.array([640.0, 480.0])
seeds = st.integers(0, 10**6)


def unrelated(seed: int, n: int) -> PointMatches:
    rng = np.random.default_rng(seed)
    return PointMatches(rng.uniform(0, SIZE, (n, 2)), rng.uniform(0, SIZE, (n, 2)), rng.random(n))


def related(seed: int, good: int, wrong: int, noise: float = 0.5) -> PointMatches:
    """Points of a deep scene: each is carried by a plane, and moved along one direction by its depth."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, SIZE, (good, 2))
    plane = turn(seed % 40 - 20, 1.1, SIZE / 2, (10.0, -5.0))
    right = geometry.project(plane, left) + rng.uniform(0, 60, (good, 1)) * [0.9, 0.3]
    right += rng.normal(0, noise, right.shape)
    return PointMatches.join([PointMatches(left, right, rng.random(good)), unrelated(seed + 1, wrong)])


def initial(points: PointMatches) -> InitialGeometry:
    return initial_geometry(points, CONFIG, 0)


@given(seeds, st.integers(8, 400))
@settings(max_examples=30, deadline=None)
def test_points_paired_at_random_are_chance(seed: int, n: int) -> None:
    assert not initial(unrelated(seed, n)).supported


@given(seeds, st.integers(30, 100), st.integers(0, 60))
@settings(max_examples=20, deadline=None)
def test_a_scene_is_more_than_chance(seed: int, good: int, wrong: int) -> None:
    assert initial(related(seed, good, wrong)).supported


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_points_in_heaps_are_chance(seed: int) -> None:
    """Unrelated photographs have their points in a few places of texture, each place in one place of the other."""
    rng = np.random.default_rng(seed)
    heaps = unrelated(seed, 5)
    heap = rng.integers(0, 5, 80)
    near = rng.normal(0, 3.0, (2, 80, 2))
    assert not initial(PointMatches(heaps.left[heap] + near[0], heaps.right[heap] + near[1], rng.random(80))).supported


def test_what_is_said_many_times_counts_once() -> None:
    once = related(3, 12, 10)
    rng = np.random.default_rng(0)
    rows = np.tile(np.arange(len(once)), 20)
    again = PointMatches(
        once.left[rows] + rng.uniform(-2, 2, (len(rows), 2)),
        once.right[rows] + rng.uniform(-2, 2, (len(rows), 2)),
        once.score[rows],
    )
    assert initial(again).chance == pytest.approx(initial(once).chance, abs=4)


def test_more_points_that_agree_are_less_chance_and_more_that_were_tried_are_more() -> None:
    def chance(good: int, wrong: int) -> float:
        return initial(related(0, good, wrong)).chance

    assert chance(100, 20) < chance(50, 20) < chance(25, 20)
    assert chance(50, 20) < chance(50, 100) < chance(50, 300)


@pytest.mark.parametrize("n", [0, 1, 7, 8])
def test_a_few_points_prove_nothing(n: int) -> None:
    points = related(0, n, 0)
    assert log_chance(np.eye(3), points, np.ones(n, bool), 7, 3, LIMITS) > -LIMITS.significance
    assert not is_mirrored(points, np.ones(n, bool), LIMITS)
    assert initial(points).chance > -LIMITS.significance


def test_many_points_are_judged_as_fast() -> None:
    points = related(0, 60_000, 20_000)
    assert initial(points).supported
    assert not initial(points).mirrored


@given(seeds, st.sampled_from([0.0, 90.0, 180.0, -60.0]), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_mirrored_photograph(seed: int, angle: float, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, SIZE, (200, 2))
    right = geometry.project(turn(angle, 0.9, SIZE / 2, (8.0, 3.0)), left)
    if not flat:
        right = right + rng.uniform(0, 8, (200, 1)) * [0.8, 0.6]
    points = PointMatches(left, right + rng.normal(0, 0.3, right.shape), np.ones(200))
    turned_over = PointMatches(left, points.right * [-1, 1] + [SIZE[0], 0], points.score)
    assert not initial(points).mirrored
    assert initial(turned_over).mirrored


def test_points_on_a_line_have_no_side() -> None:
    left = np.c_[np.arange(50) * (LIMITS.independent_distance + 4), np.full(50, 100.0)]
    assert not is_mirrored(PointMatches(left, left + 5, np.ones(50)), np.ones(50, bool), LIMITS)


def test_the_probability_of_one_scene_falls_from_one_to_that_of_no_evidence():
    chances = np.r_[-2000.0, np.linspace(-40, 20, 121), 1000.0]
    found = np.array([same_scene(float(chance), LIMITS) for chance in chances])
    assert (np.diff(found) <= 0).all()
    assert found[0] == 1
    assert found[-1] == LIMITS.unsupported
    assert same_scene(-LIMITS.significance, LIMITS) == pytest.approx((1 + LIMITS.unsupported) / 2)
    assert same_scene(-27.9, LIMITS) > 0.999  # the least evidence that a pair of one scene had
    assert same_scene(-3.3, LIMITS) < 0.05  # the most that one of two scenes had
