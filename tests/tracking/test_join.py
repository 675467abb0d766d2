"""Regions through many images."""

import numpy as np

from zpm2.model import Polygon
from zpm2.tracking.join import Observation, TrackMatch, build_tracks


def square(view: int, pair: int, number: int, x: float, size: float = 10.0) -> Observation:
    ring = np.array([[x, 0], [x + size, 0], [x + size, size], [x, size]])
    return Observation(view, pair, Polygon(number, ring))


def test_matches_join_where_regions_cover_one_another() -> None:
    matches = [
        TrackMatch(square(0, 0, 5, 0), square(1, 0, 7, 0), 0.9),
        TrackMatch(square(1, 1, 2, 0.5), square(2, 1, 3, 0), 0.8),  # the same region of image 1, another polygon
        TrackMatch(square(1, 1, 9, 50), square(2, 1, 4, 50), 0.7),
    ]
    tracks, contradicted = build_tracks(matches, 0.75)
    assert contradicted == 0
    assert [track.views for track in tracks] == [[0, 1, 2], [1, 2]]
    assert tracks[0].matches == (matches[0], matches[1])
    assert len(tracks[0].observations) == 4


def test_a_cycle_that_ends_elsewhere_is_cut_at_its_weakest_match() -> None:
    a = TrackMatch(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.9)
    b = TrackMatch(square(1, 1, 1, 0), square(2, 1, 1, 0), 0.8)
    c = TrackMatch(square(0, 2, 1, 30), square(2, 2, 1, 0), 0.3)  # began in another region
    tracks, contradicted = build_tracks([c, a, b], 0.75)
    assert contradicted == 1
    assert [track.matches for track in tracks] == [(a, b)]
    tracks, contradicted = build_tracks([c, a], 0.75)  # without b nothing is closed
    assert contradicted == 0
    assert len(tracks) == 2


def test_polygons_of_one_pair_stay_two_regions() -> None:
    matches = [
        TrackMatch(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.9),
        TrackMatch(square(0, 0, 2, 0.2), square(1, 0, 2, 0.2), 0.8),
    ]
    tracks, _ = build_tracks(matches, 0.75)
    assert [track.views for track in tracks] == [[0, 1], [0, 1]]


def test_nothing() -> None:
    assert build_tracks([], 0.75) == ([], 0)
