"""Inner distances by hand, the alignment against all alignments there are, and the invariances of IDSC."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rings import L_SHAPE, U_SHAPE, generators, hulls, star, stars, turned
from scipy.spatial.distance import cdist

from zpm2.baselines import InnerDistance, ShapeContext
from zpm2.baselines.contour import outline, sample
from zpm2.baselines.histograms import compare
from zpm2.baselines.inner_distance import align_ordered, inner_paths
from zpm2.errors import ConfigError
from zpm2.model import Polygon

SAME = 2e-3  # a sample that lies on the limit of two bins may fall into either
METHOD = InnerDistance()


def distance(method, first, second):
    shapes = method.describe([Polygon(0, first), Polygon(1, second)])
    return compare(shapes[:1], shapes[1:], method.align)[0, 0]


def path(ring, n, start, end):
    """Length and first direction of the shortest path between two of the ring's n samples."""
    points = sample(ring, n)
    i, j = (np.flatnonzero(np.hypot(*(points - p).T) < 1e-9)[0] for p in (start, end))
    length, angle = inner_paths(ring, points)
    assert np.isclose(length[i, j], length[j, i])
    return length[i, j], angle[i, j]


@pytest.mark.parametrize(
    ("ring", "n", "start", "end", "length", "towards"),
    [
        (L_SHAPE, 80, (2, 1), (1, 2), 2, (1, 1)),
        (L_SHAPE, 80, (2, 0.5), (0.5, 2), 2 * np.hypot(1, 0.5), (1, 1)),
        (L_SHAPE, 80, (2, 0), (0, 2), np.hypot(2, 2), (0, 2)),
        (L_SHAPE, 80, (0, 0), (1, 2), np.hypot(1, 2), (1, 2)),
        (U_SHAPE, 160, (1, 3), (2, 3), 5, (1, 1)),
        (U_SHAPE, 160, (0, 3), (3, 3), 2 * np.hypot(1, 2) + 1, (1, 1)),
        (U_SHAPE, 160, (0, 0), (2, 3), 2 + np.hypot(2, 1), (2, 1)),
    ],
)
def test_paths_by_hand(ring, n, start, end, length, towards):
    found, angle = path(ring, n, start, end)
    assert np.isclose(found, length)
    assert np.isclose(angle, np.arctan2(towards[1] - start[1], towards[0] - start[0]))


@settings(deadline=None)
@given(hulls)
def test_inner_is_euclidean_in_convex_polygons(ring):
    ring = outline(ring)
    points = sample(ring, 40)
    length, angle = inner_paths(ring, points)
    away = points[None] - points[:, None]
    assert np.allclose(length, np.hypot(away[..., 0], away[..., 1]), atol=1e-9)
    turn = (angle - np.arctan2(away[..., 1], away[..., 0]) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turn).max() < 1e-6


@settings(deadline=None)
@given(stars)
def test_inner_distances_are_a_metric_not_below_the_euclidean_one(ring):
    ring = outline(ring)
    points = sample(ring, 40)
    length, _ = inner_paths(ring, points)
    assert np.isfinite(length).all()
    assert np.array_equal(length, length.T)
    assert (length >= cdist(points, points) - 1e-9).all()
    assert (length <= length[:, :, None].transpose(0, 2, 1) + length[None] + 1e-9).all()


def best_by_trying(cost, penalty, starts):
    """The least mean cost over all partial matchings in order and all shifts."""
    n, m = cost.shape
    found = []
    for s in range(starts):
        rolled = np.roll(cost, -(s * m // starts), axis=1)
        for k in range(min(n, m) + 1):
            for rows in combinations(range(n), k):
                found += [rolled[rows, c].sum() + (n - k) * penalty for c in combinations(range(m), k)]
    return min(found) / n


@settings(max_examples=40, deadline=None)
@given(generators, st.integers(2, 5), st.integers(2, 5), st.floats(0.01, 1.0), st.integers(1, 2))
def test_the_alignment_is_the_best_in_order(rng, n, m, penalty, starts):
    costs = rng.uniform(size=(3, n, m)).astype(np.float32)
    expected = [best_by_trying(cost.astype(float), penalty, starts) for cost in costs]
    assert np.allclose(align_ordered(costs, penalty, starts), expected, atol=1e-6)


def test_alignment_keeps_the_order_where_an_assignment_does_not():
    crossed = np.array([[[1, 0, 1, 1], [0, 1, 1, 1], [1, 1, 0, 1], [1, 1, 1, 0]]], np.float32)
    assert ShapeContext().align(crossed) == 0
    assert np.isclose(align_ordered(crossed, 0.4, 1), 0.1)


def test_a_later_start_is_found():
    costs = 1 - np.roll(np.eye(16, dtype=np.float32), 4, axis=1)[None]
    assert align_ordered(costs, 0.3, 1) > 0.07
    assert align_ordered(costs, 0.3, 8) == 0


@settings(max_examples=20, deadline=None)
@given(
    stars,
    st.integers(0, 50),
    st.floats(-180, 180),
    st.floats(0.01, 100),
    st.floats(-5000, 5000),
    st.floats(-5000, 5000),
)
def test_place_size_rotation_and_first_vertex_do_not_matter(ring, start, degrees, scale, x, y):
    assert distance(METHOD, ring, turned(np.roll(ring, start, axis=0), degrees) * scale + [x, y]) < SAME


@settings(max_examples=20, deadline=None)
@given(generators)
def test_noise_changes_less_than_another_shape(rng):
    ring, other = star(rng, 12), star(rng, 12)
    noisy = ring + rng.normal(scale=0.05, size=ring.shape)
    assert distance(METHOD, ring, noisy) < distance(METHOD, ring, other)


def test_bending_at_a_joint_changes_little():
    def elbow(degrees):
        hand = turned(np.array([[12.0, -1.0], [12.0, 1.0]]), degrees)
        return np.array([*hand, [-1, 1], [-12, 1], [-12, -1], [1, -1]])

    straight, bent = elbow(0), elbow(70)
    assert distance(METHOD, straight, bent) < 0.5 * distance(ShapeContext(rotated=True), straight, bent)


def test_holes_are_no_obstacle():
    ring = np.array([[0, 0], [9, 0], [9, 5], [0, 5]], float)
    whole, pierced = Polygon(0, ring), Polygon(0, ring, (np.array([[2, 2], [2, 3], [7, 3]], float),))
    assert np.array_equal(METHOD.describe([whole]), METHOD.describe([pierced]))


@pytest.mark.parametrize("settings", [{"penalty": 0.0}, {"penalty": 2.0}, {"starts": 0}, {"starts": 101}])
def test_settings_that_cannot_be_used(settings):
    with pytest.raises(ConfigError, match="occlusion penalty"):
        InnerDistance(**settings)
