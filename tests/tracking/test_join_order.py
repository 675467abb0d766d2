"""Tracks do not depend on the order of the matches, and carried outlines come after detected ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.model import Polygon
from zpm2.tracking.join import Observation, Track, TrackMatch, _votes, build_tracks

SAME = 0.75


def square(view: int, pair: int, number: int, x: float) -> Observation:
    return Observation(view, pair, Polygon(number, np.array([[x, 0], [x + 10, 0], [x + 10, 10], [x, 10.0]])))


def places(tracks: list[Track]) -> set[frozenset[tuple[int, float]]]:
    """Each track as where it is in each view, to the nearest region."""
    return {frozenset((v, round(seen.polygon.bounds[0], -1)) for v, seen in track.seen.items()) for track in tracks}


@given(st.permutations(range(12)), st.lists(st.integers(0, 2), min_size=12, max_size=12), st.booleans())
def test_the_order_of_matches_does_not_matter(order: list[int], ends: list[int], votes: bool) -> None:
    """Regions at x = 0, 20, 40 of four views; matches of all pairs, some of them wrong, none equally confident."""
    pairs = [(i, j) for i in range(4) for j in range(i + 1, 4)] * 2
    matches = [
        TrackMatch(square(i, n, 0, 20 * (n % 3)), square(j, n, 0, 20 * end), 0.5 + n / 100)
        for n, ((i, j), end) in enumerate(zip(pairs, ends, strict=True))
    ]
    first, contradicted = build_tracks(matches, SAME, votes)
    again, number = build_tracks([matches[k] for k in order], SAME, votes)
    assert places(again) == places(first)
    assert number == contradicted
    for track in first:
        assert len(track.seen) == len(track.views)  # one region of each view


def test_a_detected_match_comes_before_a_carried_one() -> None:
    carried = TrackMatch(square(0, 0, 1, 0), square(1, 1, 0, 40), 0.99, carried=True)
    detected = TrackMatch(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.6)
    (track,), contradicted = build_tracks([carried, detected], SAME)
    assert contradicted == 1
    assert track.matches == (detected,)


def test_a_carried_outline_on_a_known_region_joins_two_tracks() -> None:
    a = TrackMatch(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.9)
    b = TrackMatch(square(2, 1, 1, 20), square(3, 1, 1, 20), 0.8)
    bridge = TrackMatch(a.right, square(2, 2, 0, 20.5), 0.85, carried=True)
    (track,), contradicted = build_tracks([a, b, bridge], SAME)
    assert contradicted == 0
    assert track.views == [0, 1, 2, 3]
    assert track.seen[2].pair == 1  # as it was detected


def test_what_third_images_say_outweighs_one_confident_match() -> None:
    """Views 0, 1, 2 and 3 see the region at 0; the match of 0 and 1 leads elsewhere, and is the most confident."""
    wrong = TrackMatch(square(0, 0, 1, 0), square(1, 0, 1, 40), 0.99)
    right = [
        TrackMatch(square(i, n, 1, 0), square(j, n, 1, 0), 0.9)
        for n, (i, j) in enumerate(((0, 2), (0, 3), (1, 2), (1, 3), (2, 3)), start=1)
    ]
    tracks, _ = build_tracks([wrong, *right], SAME)
    assert wrong in tracks[0].matches + tracks[-1].matches
    (track,), contradicted = build_tracks([wrong, *right], SAME, votes=True)
    assert contradicted == 1
    assert track.views == [0, 1, 2, 3]
    assert set(track.matches) == set(right)


def test_votes_are_counted_as_said() -> None:
    """Triangles: one that closes, one that does not, and a region that leads on to another one of the same view."""
    a, b, c = square(0, 0, 1, 0), square(1, 0, 1, 0), square(2, 1, 1, 0)
    closed = [TrackMatch(a, b, 0.8), TrackMatch(a, c, 0.9), TrackMatch(b, c, 0.5)]
    ends = [((0, 0), (1, 0)), ((0, 0), (2, 0)), ((1, 0), (2, 0))]
    assert _votes(closed, ends)[0] == pytest.approx((0.8 + 0.45) / 1.45)
    assert _votes(closed, [*ends[:2], ((1, 0), (2, 7))])[0] == pytest.approx(0.8 / 1.45)
    assert _votes(closed, [*ends[:2], ((1, 7), (2, 0))])[0] == pytest.approx(0.8 / 1.45)
    assert _votes(closed[:2], ends[:2])[0] == 0.8
    carried = [*closed[:2], TrackMatch(b, c, 0.5, carried=True)]
    assert _votes(carried, ends)[0] == 0.8  # it has no vote
