"""What all methods share: mutual best, greedy, and settings that are checked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rings import generators

from zpm2.baselines import Masa, Mesa, Sgam, Vote
from zpm2.baselines.method import greedy, mutual_best
from zpm2.errors import ConfigError


@given(generators, st.integers(0, 12))
def test_mutual_best_and_greedy_are_what_their_loops_say(rng, n):
    pairs = np.argwhere(rng.uniform(size=(4, 5)) < 0.6)[:n].astype(np.int64)
    score = rng.integers(0, 4, len(pairs)) / 4  # with ties
    best = {side: {} for side in (0, 1)}
    for row, pair in enumerate(pairs.tolist()):
        for side in (0, 1):
            known = best[side].setdefault(pair[side], row)
            if score[row] > score[known]:
                best[side][pair[side]] = row
    both = [row for row, (i, j) in enumerate(pairs.tolist()) if best[0][i] == row == best[1][j]]
    assert mutual_best(pairs, score).tolist() == both

    left, kept = set(range(len(pairs))), []
    while left:
        row = min(left, key=lambda k: (-score[k], k))
        kept.append(row)
        left = {k for k in left if pairs[k][0] != pairs[row][0] and pairs[k][1] != pairs[row][1]}
    assert greedy(pairs, score).tolist() == sorted(kept)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Vote(min_points=0), "vote: min_points must be at least 1, got 0"),
        (lambda: Masa(min_score=1.5), r"masa: min_score is a share from 0 to 1, got 1.5"),
        (lambda: Masa(temperature=0.0), "masa: temperature must be above 0, got 0.0"),
        (lambda: Sgam(phi=float("nan")), "sgam: phi must be a finite number"),
        (lambda: Mesa(contained=0.0), "mesa: contained must be above 0"),
    ],
)
def test_settings_out_of_range(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
