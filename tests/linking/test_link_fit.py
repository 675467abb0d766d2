"""One shift and turn between two layers, and none where there is none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from towns import houses, moved, shapes

from zpm2 import memory
from zpm2.config import LinkConfig
from zpm2.errors import Failed, InputError
from zpm2.linking.fit import first_fit, nearest_pairs
from zpm2.linking.similarity import Similarity, fitted, rotation
from zpm2.linking.vote import _table

CONFIG = LinkConfig()
QUICK = LinkConfig(max_reach=25.0, seeds=2)


@given(
    st.floats(0, 15), st.floats(0, 360), st.floats(-5, 5), st.integers(12, 80), st.integers(0, 1000), st.floats(0, 0.8)
)
def test_any_shift_and_turn_is_found(length, direction, turn, count, seed, noise):
    shift = (length * np.cos(np.radians(direction)), length * np.sin(np.radians(direction)))
    left = houses(count, seed)
    fit = first_fit(shapes(left), shapes(moved(left, shift, turn, noise)), CONFIG)
    assert fit, fit
    truth = moved(left, shift, turn).mean(1)
    assert np.median(np.hypot(*(fit.similarity(left.mean(1)) - truth).T)) < 0.1 + 1.5 * noise
    assert np.median(np.hypot(*(fit.places - truth).T)) < 0.1 + 1.5 * noise


def test_its_uncertainty_is_that_of_repeated_estimates():
    left = houses(60)
    fits = [first_fit(shapes(left), shapes(moved(left, (4, -3), 2.0, 0.6, seed)), QUICK) for seed in range(20)]
    center = left.mean((0, 1))
    shifts = np.array([fit.similarity.about(center).shift for fit in fits])
    turns = np.array([fit.similarity.turn for fit in fits])
    told = fits[0].uncertainty
    assert 0.4 < shifts.std(0).mean() / told.shift < 2.5
    assert 0.4 < turns.std() / told.turn < 2.5
    assert abs(turns.mean() - 2.0) < 3 * told.turn


def test_a_shift_far_beyond_the_usual_and_half_of_the_houses_gone():
    left = houses(150)
    right = moved(left, (310.0, -150.0), 4.0, 0.3)[::2]
    fit = first_fit(shapes(left), shapes(right), CONFIG)
    assert fit.similarity.turn == pytest.approx(4.0, abs=0.1)
    assert np.hypot(*(fit.places[::2] - right.mean(1)).T).max() < 1.5


def test_a_slow_local_variation_is_followed():
    left = houses(200)
    centers = left.mean(1)
    bend = 4.0 * np.sin(centers[:, 0] / 120.0)  # m, to the north
    right = left + np.stack([np.zeros_like(bend), bend], -1)[:, None]
    fit = first_fit(shapes(left), shapes(right), CONFIG)
    off, flat = (np.hypot(*(p - right.mean(1)).T) for p in (fit.places, fit.similarity(centers)))
    assert np.median(off) < 0.5 * np.median(flat)


@pytest.mark.parametrize("count", [12, 60, 150])
def test_unrelated_layers_fail(count):
    for seed in range(3):
        fit = first_fit(shapes(houses(count, seed)), shapes(houses(count, seed + 50)), QUICK)
        assert isinstance(fit, Failed)


def test_mirrored_and_repeating_layers_fail():
    left = houses(150)
    mirrored = first_fit(shapes(left), shapes((left * (-1, 1) + (left[..., 0].max(), 0))[:, ::-1]), QUICK)
    assert isinstance(mirrored, Failed)
    rows = np.stack(np.meshgrid(np.arange(12), np.arange(12)), -1).reshape(-1, 1, 2) * 15.0
    same = rows + np.array([(0, 0), (8, 0), (8, 8), (0, 8)])
    grid = first_fit(shapes(same), shapes(same), QUICK)
    assert isinstance(grid, Failed)
    assert "repeat" in str(grid)


def test_layers_far_apart_and_of_a_single_house_fail():
    left = houses(20)
    far = first_fit(shapes(left), shapes(left + 1e5), CONFIG)
    assert "within 2000 m" in str(far)
    assert isinstance(first_fit(shapes(left[:1]), shapes(left[:1]), CONFIG), Failed)


@pytest.mark.parametrize("count", [30, 250])
@pytest.mark.parametrize("growth", [0.0, 0.002])
def test_a_stack_of_polygons_is_one_place(count, growth):
    """Cadastres hold some outlines several times, at times more often than `seed_polygons`."""
    left = houses(60)
    center, scales = left[7].mean(0), 1 + growth * np.arange(count)[:, None, None]
    left = np.concatenate([left, center + scales * (left[7] - center)])
    right = left + np.array([6.0, -6.0])
    fit = first_fit(shapes(left), shapes(right), CONFIG)
    assert fit.places == pytest.approx(right.mean(1), abs=0.01)


def test_a_table_of_votes_that_does_not_fit_into_memory_is_refused():
    left = shapes(houses(20))
    with memory.within("1MB"), pytest.raises(InputError, match=r"larger link\.tolerance"):
        first_fit(left, left, LinkConfig(tolerance=0.01))


def test_votes_are_those_of_a_readable_count():
    rng = np.random.default_rng(0)
    here, there = rng.uniform(-20, 20, (60, 2)), rng.uniform(-20, 20, (60, 2))
    tolerance, bins = 3.0, 4
    table = _table(here, there, tolerance, bins)
    assert table.shape == (7, 7)
    for y in range(7):
        for x in range(7):
            off = there - here - (np.array([x, y]) + 1 - bins) * tolerance
            assert table[y, x] == ((off >= -tolerance) & (off < tolerance)).all(1).sum()


def test_nearest_pairs_are_those_of_all_distances():
    rng = np.random.default_rng(0)
    places, centers = rng.uniform(0, 50, (40, 2)), rng.uniform(0, 50, (30, 2))
    away = np.hypot(*(places[:, None] - centers).transpose(2, 0, 1))
    brute = [
        (i, j)
        for i in range(40)
        for j in range(30)
        if away[i, j] == away[i].min() == away[:, j].min() and away[i, j] < 5
    ]
    assert list(zip(*nearest_pairs(places, centers, 5.0), strict=True)) == brute


@given(st.floats(-180, 180), st.floats(0.5, 2.0), st.floats(-1e3, 1e3), st.integers(0, 99))
def test_a_similarity_is_fitted_exactly(turn, scale, shift, seed):
    points = np.random.default_rng(seed).normal(0, 100, (5, 2))
    map_ = Similarity(np.array([3.0, 4.0]), np.array([shift, 7.0]), turn, scale)
    found = fitted(points, map_(points), np.arange(1.0, 6.0))
    assert found(points) == pytest.approx(map_(points), abs=1e-6)
    assert found.scale == pytest.approx(scale)
    assert rotation(found.turn) == pytest.approx(rotation(turn), abs=1e-6)
    assert found.about(np.zeros(2))(points) == pytest.approx(map_(points), abs=1e-6)
