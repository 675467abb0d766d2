"""Samples of outlines: where they lie, and what they do not depend on."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rings import L_SHAPE, stars, turned

from zpm2.baselines.contour import outline, sample, tangents


def test_a_square_by_hand():
    ring = outline(np.array([[4.0, 4.0], [8.0, 4.0], [8.0, 8.0], [4.0, 8.0]]))
    e = 1 / 8
    assert np.allclose(ring, [[-e, -e], [e, -e], [e, e], [-e, e]])
    points = sample(ring, 8)
    assert np.allclose(points, [[-e, -e], [0, -e], [e, -e], [e, 0], [e, e], [0, e], [-e, e], [-e, 0]])
    assert np.allclose(np.degrees(tangents(points)), [-45, 0, 45, 90, 135, 180, -135, -90])


def test_vertices_are_samples_where_the_step_divides_the_edges():
    points = sample(outline(L_SHAPE), 16)
    for vertex in outline(L_SHAPE):
        assert np.hypot(*(points - vertex).T).min() < 1e-12


@settings(deadline=None)
@given(stars, st.integers(3, 150))
def test_samples_are_equally_far_along_the_ring(ring, n):
    ring = outline(ring)
    closed = np.concatenate([ring, ring[:1]])
    edges = np.diff(closed, axis=0)
    length = np.hypot(*edges.T)
    assert np.isclose(length.sum(), 1)
    points = sample(ring, n)
    along = (points[:, None] - ring) * edges / length[:, None]
    on = np.clip(along.sum(2), 0, length)
    off = np.hypot(*np.moveaxis(points[:, None] - ring - on[..., None] * edges / length[:, None], 2, 0))
    assert off.min(1).max() < 1e-12
    where = (np.concatenate([[0], np.cumsum(length)[:-1]]) + on)[np.arange(n), off.argmin(1)]
    assert np.allclose(where % 1, np.arange(n) / n, atol=1e-9)


@settings(deadline=None)
@given(stars, st.integers(0, 50), st.floats(0.01, 100), st.floats(-1000, 1000), st.floats(-1000, 1000))
def test_start_place_and_size_of_the_ring_do_not_matter(ring, start, scale, x, y):
    other = np.roll(ring, start, axis=0) * scale + [x, y]
    assert np.allclose(sample(outline(other), 50), sample(outline(ring), 50), atol=1e-9)


@settings(deadline=None)
@given(stars, st.floats(-180, 180))
def test_samples_turn_with_the_ring(ring, degrees):
    points = sample(outline(ring), 50)
    assert np.allclose(sample(outline(turned(ring, degrees)), 50), turned(points, degrees), atol=1e-9)


@settings(deadline=None)
@given(stars, st.data())
def test_further_vertices_on_the_edges_do_not_matter(ring, data):
    k, share = data.draw(st.integers(0, len(ring) - 1)), data.draw(st.sampled_from([0.0, 0.3, 0.5]))
    more = np.insert(ring, k + 1, ring[k] + share * (ring[(k + 1) % len(ring)] - ring[k]), axis=0)
    assert np.allclose(sample(outline(more), 50), sample(outline(ring), 50), atol=1e-9)
