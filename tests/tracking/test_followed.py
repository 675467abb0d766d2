"""Errands of regions into photographs where they were missed, splits and merges."""

import numpy as np
import pytest
import shapely

from zpm2.carry import CarryResult, Outcome
from zpm2.carry.result import Side
from zpm2.config import TracksConfig, preset
from zpm2.model import PointMatches, Polygon
from zpm2.polygons.shapes import from_shape
from zpm2.tracking.events import Event, events
from zpm2.tracking.extend import absent_in, carried_matches, carried_regions, errands
from zpm2.tracking.join import Observation, TrackMatch, build_tracks
from zpm2.tracking.matches import CarriedRegions, PairMatches

CONFIG, LOCAL = TracksConfig(), preset("default").local_match


def seen(view: int, pair: int, number: int, x: float) -> Observation:
    return Observation(view, pair, from_shape(shapely.box(x, 0, x + 10, 10), number))


TRACKS, _ = build_tracks(
    [
        TrackMatch(seen(0, 0, 1, 0), seen(1, 0, 1, 0), 0.9),
        TrackMatch(seen(1, 1, 1, 0), seen(2, 1, 1, 0), 0.8),
        TrackMatch(seen(1, 1, 2, 20), seen(2, 1, 2, 20), 0.7),
    ],
    0.75,
)
STRENGTH = {(0, 1): 5, (1, 2): 9, (0, 3): 0, (1, 3): 4, (2, 3): 7}


def test_regions_are_looked_for_in_neighbours_from_the_nearest_photograph():
    made = {(each.source, each.target): each.tracks for each in errands(TRACKS, STRENGTH, CONFIG)}
    assert made == {(1, 0): (1,), (2, 3): (0, 1)}  # not in 3 from 0, where nothing matched


def test_the_longest_tracks_go_first():
    few = TracksConfig(max_carried=1)
    assert {(each.source, each.target): each.tracks for each in errands(TRACKS, STRENGTH, few)}[2, 3] == (0,)


def test_only_sure_outlines_join_a_track():
    (errand,) = [each for each in errands(TRACKS, STRENGTH, CONFIG) if each.target == 3]
    two = shapely.MultiPolygon([shapely.box(0, 0, 9, 9), shapely.box(20, 20, 22, 22)])
    outcomes = [Outcome("in part", "", two, 0.9, 0.5), Outcome("found", "", shapely.box(20, 0, 30, 10), 0.4, 1.0)]
    side = Side(None, 40, 30)
    found = carried_regions(CarryResult(side, side, [], [], outcomes))
    assert found.status == ["in part", "found"]
    (match,) = carried_matches(errand, found, 7, CONFIG)
    assert match.carried
    assert match.left == TRACKS[0].seen[2]
    assert (match.right.view, match.right.pair) == (3, 7)
    assert match.right.polygon.area == pytest.approx(81)


def test_what_was_looked_for_in_vain_is_told():
    (errand,) = [each for each in errands(TRACKS, STRENGTH, CONFIG) if each.target == 3]
    carried = CarriedRegions(["hidden", "found"], np.array([0.0, 0.5]), [])
    assert absent_in(TRACKS, [(errand, carried)]) == [{3: "hidden"}, {3: "unsure"}]
    joined, _ = build_tracks([*TRACKS[0].matches, TrackMatch(TRACKS[0].seen[2], seen(3, 7, 0, 0), 0.9, True)], 0.75)
    assert absent_in([*joined, TRACKS[1]], [(errand, carried)]) == [{}, {3: "unsure"}]


def square(x: float, y: float, side: float) -> Polygon:
    return from_shape(shapely.box(x, y, x + side, y + side), 0)


@pytest.fixture
def moved() -> PairMatches:
    """The right photograph is the left one moved by 50 px."""
    at = np.random.default_rng(0).uniform(0, 100, (200, 2))
    shift = np.array([[1.0, 0, 50], [0, 1, 0], [0, 0, 1]])
    points = PointMatches(at, at + np.array([50, 0]), np.ones(200))
    return PairMatches([], [], np.zeros(0), points, shift, [], [])


def test_a_region_whose_place_is_filled_by_several_is_split(moved):
    parts = {2: square(60, 10, 20), 3: from_shape(shapely.box(80, 10, 90, 40), 0), 5: square(60, 30, 10)}
    polygons = {0: {1: square(10, 10, 30)}, 1: {**parts, 4: square(120, 10, 10)}}
    assert events(polygons, (0, 1), moved, CONFIG, LOCAL) == [Event("split", 1, (2, 3, 5), 0, 1)]


def test_several_regions_that_become_one_are_merged(moved):
    polygons = {0: {1: square(10, 10, 20), 2: from_shape(shapely.box(30, 10, 40, 30), 0)}}
    polygons[1] = {3: from_shape(shapely.box(60, 10, 90, 30), 0)}
    assert events(polygons, (0, 1), moved, CONFIG, LOCAL) == [Event("merge", 3, (1, 2), 1, 0)]


def test_no_event_where_both_see_the_region_or_most_is_missing(moved):
    halves = {2: from_shape(shapely.box(60, 10, 75, 40), 0), 3: from_shape(shapely.box(75, 10, 90, 40), 0)}
    both = {0: {1: square(10, 10, 30)}, 1: {1: square(60, 10, 30), **halves}}
    assert events(both, (0, 1), moved, CONFIG, LOCAL) == []
    few = {0: {1: square(10, 10, 30)}, 1: {2: square(60, 10, 10), 3: square(75, 10, 10)}}
    assert events(few, (0, 1), moved, CONFIG, LOCAL) == []
    unknown = PairMatches([], [], np.zeros(0), PointMatches.empty(), None, [], [])
    assert events({0: {1: square(10, 10, 30)}, 1: halves}, (0, 1), unknown, CONFIG, LOCAL) == []
