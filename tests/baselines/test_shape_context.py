"""Shape Context: its invariances, what it tells apart, and its assignment."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rings import generators, star, stars, turned

from zpm2.baselines import ShapeContext
from zpm2.baselines.histograms import compare
from zpm2.model import Polygon

SAME = 2e-3  # a sample that lies on the limit of two bins may fall into either
UPRIGHT, ROTATED = ShapeContext(), ShapeContext(rotated=True)


def distance(method, first, second):
    shapes = method.describe([Polygon(0, first), Polygon(1, second)])
    return compare(shapes[:1], shapes[1:], method.align)[0, 0]


@pytest.mark.parametrize("method", [UPRIGHT, ROTATED], ids=["upright", "rotated"])
@settings(max_examples=30, deadline=None)
@given(stars, st.integers(0, 50), st.floats(0.01, 100), st.floats(-5000, 5000), st.floats(-5000, 5000))
def test_place_size_and_first_vertex_do_not_matter(method, ring, start, scale, x, y):
    assert distance(method, ring, np.roll(ring, start, axis=0) * scale + [x, y]) < SAME


@settings(max_examples=30, deadline=None)
@given(stars, st.floats(-180, 180))
def test_rotation_does_not_matter_in_the_tangent_frame(ring, degrees):
    assert distance(ROTATED, ring, turned(ring, degrees)) < SAME


def test_rotation_matters_otherwise():
    ring = star(np.random.default_rng(0), 9)
    assert distance(UPRIGHT, ring, turned(ring, 40)) > 0.1


@settings(max_examples=30, deadline=None)
@given(generators)
def test_noise_changes_less_than_another_shape(rng):
    ring, other = star(rng, 12), star(rng, 12)
    noisy = ring + rng.normal(scale=0.05, size=ring.shape)
    assert distance(UPRIGHT, ring, noisy) < distance(UPRIGHT, ring, other)


@settings(max_examples=30, deadline=None)
@given(stars, stars)
def test_distance_is_symmetric_and_at_most_1(first, second):
    there, back = distance(UPRIGHT, first, second), distance(UPRIGHT, second, first)
    assert 0 <= there <= 1
    assert np.isclose(there, back, atol=1e-5)


def test_holes_are_not_looked_at():
    ring = np.array([[0, 0], [9, 0], [9, 5], [0, 5]], float)
    whole, pierced = Polygon(0, ring), Polygon(0, ring, (np.array([[2, 2], [2, 3], [3, 3]], float),))
    assert np.array_equal(UPRIGHT.describe([whole]), UPRIGHT.describe([pierced]))


@settings(deadline=None)
@given(generators)
def test_the_assignment_is_the_best_one(rng):
    costs = rng.uniform(size=(3, 5, 5)).astype(np.float32)
    best = [min(cost[np.arange(5), p].mean() for p in permutations(range(5))) for cost in costs]
    assert np.allclose(UPRIGHT.align(costs), best, atol=1e-6)
