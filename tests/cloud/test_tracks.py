"""Regions through many images."""

import numpy as np

from zpm2.cloud.tracks import Link, Sighting, chain
from zpm2.model import Polygon


def square(view: int, pair: int, number: int, x: float, size: float = 10.0) -> Sighting:
    ring = np.array([[x, 0], [x + size, 0], [x + size, size], [x, size]])
    return Sighting(view, pair, Polygon(number, ring))


def test_matches_chain_where_regions_cover_one_another() -> None:
    links = [
        Link(square(0, 0, 5, 0), square(1, 0, 7, 0), 0.9),
        Link(square(1, 1, 2, 0.5), square(2, 1, 3, 0), 0.8),  # the same region of image 1, another polygon
        Link(square(1, 1, 9, 50), square(2, 1, 4, 50), 0.7),
    ]
    tracks, contradicted = chain(links, 0.75)
    assert contradicted == 0
    assert [track.views for track in tracks] == [[0, 1, 2], [1, 2]]
    assert tracks[0].links == (links[0], links[1])
    assert len(tracks[0].sightings) == 4


def test_a_cycle_that_ends_elsewhere_is_cut_at_its_weakest_link() -> None:
    a = Link(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.9)
    b = Link(square(1, 1, 1, 0), square(2, 1, 1, 0), 0.8)
    c = Link(square(0, 2, 1, 30), square(2, 2, 1, 0), 0.3)  # says that it began in another region
    tracks, contradicted = chain([c, a, b], 0.75)
    assert contradicted == 1
    assert [track.links for track in tracks] == [(a, b)]
    tracks, contradicted = chain([c, a], 0.75)  # without b nothing is closed
    assert contradicted == 0
    assert len(tracks) == 2


def test_polygons_of_one_pair_stay_two_regions() -> None:
    links = [
        Link(square(0, 0, 1, 0), square(1, 0, 1, 0), 0.9),
        Link(square(0, 0, 2, 0.2), square(1, 0, 2, 0.2), 0.8),
    ]
    tracks, _ = chain(links, 0.75)
    assert [track.views for track in tracks] == [[0, 1], [0, 1]]


def test_nothing() -> None:
    assert chain([], 0.75) == ([], 0)
