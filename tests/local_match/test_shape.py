import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import star

from zpm2.config import LocalConfig
from zpm2.local_match import reference, shape

CONFIG = LocalConfig()
K = CONFIG.neighbors
seeds = st.integers(0, 10**6)
REGULAR = {
    "square": np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]]),
    "rectangle": np.array([[0, 0], [20, 0], [20, 7], [0, 7.0]]),
    "hexagon": 10 * np.c_[np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)],
    "stairs": np.array([[0, 0], [3, 0], [3, 1], [2, 1], [2, 2], [1, 2], [1, 3], [0, 3.0]]),
}


def moved(ring, angle, scale, shift):
    c, s = np.cos(angle), np.sin(angle)
    return scale * ring @ np.array([[c, s], [-s, c]]) + shift


@given(seeds, st.integers(3, 14), st.integers(1, 16))
@settings(max_examples=40, deadline=None)
def test_embedding_is_the_reference(seed, n, k):
    ring = star(np.random.default_rng(seed), n)
    fast = shape.embedding(ring, k)
    assert fast.shape == (n, min(k, n - 1))
    assert fast == pytest.approx(reference.embedding(ring, k), abs=1e-12)
    assert (fast >= 0).all()
    assert (fast <= 1).all()


@pytest.mark.parametrize("name", REGULAR)
def test_embedding_of_regular_shapes_is_the_reference(name):
    assert shape.embedding(REGULAR[name], K) == pytest.approx(reference.embedding(REGULAR[name], K), abs=1e-12)


def test_embedding_of_a_square_by_hand():
    # to the next vertex: no turning; to the one before: chord 1, path 3, two right angles; diagonal: one right angle
    row = [0, 1 / 3 * np.pi / (4 * np.pi), np.sqrt(2) / 2 * (np.pi / 2) / (4 * np.pi)]
    assert shape.embedding(REGULAR["square"], K) == pytest.approx(np.tile(row, (4, 1)))


def test_embeddings_together_are_those_of_each(monkeypatch):
    rng = np.random.default_rng(0)
    rings = [star(rng, n) for n in (5, 3, 9, 5, 5, 9, 4)]
    for chords in (1, 60, 10**6):
        monkeypatch.setattr(shape, "CHORD_CHUNK", chords)
        for ring, alpha in zip(rings, shape.embeddings(rings, K), strict=True):
            assert np.array_equal(alpha, shape.embedding(ring, K))
    assert shape.embeddings([], K) == []


@given(seeds, st.integers(3, 20), st.floats(-4, 4), st.floats(0.01, 100), st.floats(-1000, 1000))
@settings(max_examples=40, deadline=None)
def test_embedding_does_not_depend_on_place_rotation_and_scale(seed, n, angle, scale, shift):
    ring = star(np.random.default_rng(seed), n)
    again = shape.embedding(moved(ring, angle, scale, shift), K)
    assert again == pytest.approx(shape.embedding(ring, K), abs=1e-6)


@pytest.mark.parametrize("name", [*REGULAR, "star"])
@pytest.mark.parametrize("first", [1, 2, 3])
def test_another_first_vertex_permutes_the_rows(name, first):
    ring = REGULAR.get(name, star(np.random.default_rng(7), 11))
    rolled = shape.embedding(moved(np.roll(ring, -first, axis=0), 0.7, 3.0, 50.0), K)
    assert rolled == pytest.approx(np.roll(shape.embedding(ring, K), -first, axis=0), abs=1e-9)


@given(seeds, st.integers(4, 20), st.integers(0, 19), st.floats(-4, 4))
@settings(max_examples=40, deadline=None)
def test_a_polygon_is_itself_rotated_and_renumbered(seed, n, first, angle):
    ring = star(np.random.default_rng(seed), n)
    other = moved(np.roll(ring, -(first % n), axis=0), angle, 1.7, 30.0)
    beta, nodes = shape.node_assignment(shape.embedding(ring, K), shape.embedding(other, K))
    assert beta == pytest.approx(0, abs=1e-9)
    assert {tuple(row) for row in nodes.tolist()} == {(a, (a - first) % n) for a in range(n)}


@given(seeds, st.integers(3, 6), st.integers(3, 7))
@settings(max_examples=25, deadline=None)
def test_node_assignment_is_the_best_of_all(seed, n, m):
    rng = np.random.default_rng(seed)
    first, second = (shape.embedding(star(rng, size), K) for size in (n, m))
    beta, nodes = shape.node_assignment(first, second)
    expected, pairs = reference.geometric_discrepancy(first, second)
    assert beta == pytest.approx(expected, abs=1e-12)
    assert len(nodes) == len(pairs) == min(n, m)
    k = min(first.shape[1], second.shape[1])
    energies = [
        sum(np.linalg.norm(first[a, :k] - second[b, :k]) for a, b in chosen) for chosen in (nodes.tolist(), pairs)
    ]
    assert energies[0] == pytest.approx(energies[1], abs=1e-12)


@given(seeds, st.integers(5, 20))
@settings(max_examples=25, deadline=None)
def test_other_shapes_differ_more_than_noise(seed, n):
    rng = np.random.default_rng(seed)
    ring = star(rng, n, size=100)
    noisy, other = ring + rng.normal(0, 0.01, ring.shape), star(rng, n, size=100)
    similar, _ = shape.graph_similarity([ring, ring, ring], [ring, noisy, other], CONFIG.z, K)
    assert similar[0] == pytest.approx(1)
    assert 0 < similar[2] < similar[1] <= 1


@given(st.floats(0.1, 1e6), st.floats(0.1, 1e6), st.floats(0, 2), st.floats(0.1, 10))
def test_psi_is_the_reference(a, b, beta, z):
    fast = shape.area_ratio(np.array([a]), np.array([b])) * np.exp(-z * beta)
    assert fast[0] == pytest.approx(reference.similarity(a, b, beta, z), rel=1e-9, abs=1e-12)


def test_area_term():
    ratio = shape.area_ratio(np.array([4.0, 8.0, 5.0, 0.0, 0.0]), np.array([8.0, 4.0, 5.0, 3.0, 0.0]))
    assert ratio.tolist() == [0.5, 0.5, 1, 0, 0]


def test_graph_similarity_is_exp_of_beta():
    rng = np.random.default_rng(1)
    rings, others = [star(rng, n) for n in (5, 8, 6)], [star(rng, n) for n in (5, 6, 6)]
    similar, nodes = shape.graph_similarity(rings, others, 2.5, K)
    for k in range(3):
        beta, pairs = shape.node_assignment(shape.embedding(rings[k], K), shape.embedding(others[k], K))
        assert similar[k] == pytest.approx(np.exp(-2.5 * beta))
        assert np.array_equal(nodes[k], pairs)
    empty, none = shape.graph_similarity([], [], 2.5, K)
    assert (len(empty), none) == (0, [])
