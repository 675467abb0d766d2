"""MASA's association, against the loops of the tracker."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from region_pairs import found, region_pair, squares
from rings import generators

from zpm2.baselines import Masa
from zpm2.baselines.masa import association, take_in_turn


def unit(rng, n, c=6):
    vectors = rng.normal(size=(n, c))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@given(generators, st.integers(1, 6), st.integers(1, 6))
def test_the_score_is_bisoftmax_and_cosine(rng, m, n):
    left, right = unit(rng, m), unit(rng, n)
    score = association(left, right, 0.2)
    logits = np.array([[a @ b / 0.2 for b in right] for a in left])
    for i in range(m):
        for j in range(n):
            one = np.exp(logits[i, j]) / np.exp(logits[i]).sum()
            other = np.exp(logits[i, j]) / np.exp(logits[:, j]).sum()
            assert score[i, j] == pytest.approx(((one + other) / 2 + left[i] @ right[j]) / 2)


@given(generators, st.integers(1, 6), st.integers(1, 6))
def test_regions_are_taken_in_turn(rng, m, n):
    score, order = rng.uniform(size=(m, n)), rng.permutation(n)
    rest, pairs = score.copy(), []
    for j in order:  # as the tracker: the best track of each detection, which no later one can have
        i = int(rest[:, j].argmax())
        if rest[i, j] > 0.5:
            pairs.append((i, int(j)))
            rest[i] = 0
    assert take_in_turn(score, order, 0.5).tolist() == [list(pair) for pair in sorted(pairs)]


def test_regions_find_their_embedding():
    vectors = unit(np.random.default_rng(1), 5, 40)
    order = np.array([3, 0, 4, 1, 2])
    sides = [squares(*((10 * k, 0, 9) for k in range(5))) for _ in range(2)]
    pair = region_pair(*sides, embed=lambda shapes: (vectors, vectors[order]))
    assert set(found(Masa(), pair)) == {(int(i), j) for j, i in enumerate(order)}
    assert not found(Masa(), region_pair([], sides[1]))
