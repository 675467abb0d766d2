import dataclasses

import numpy as np
import pytest
import twoplanes
from twoplanes import scene

from zpm2.config import PRESETS
from zpm2.global_match import Candidates, initial_geometry, locate, search_candidates
from zpm2.local_match import MatchProblem, match_polygons
from zpm2.model import Image, PointMatches
from zpm2.verify import gather, judged, same_scene_matches, verified

DEFAULT = PRESETS["default"]
LOCAL = DEFAULT.local_match
NEAR, FAR = 40.0, 150.0  # px of disparity between the planes


def problem_of(given, config=DEFAULT):
    initial = initial_geometry(given.points, config.global_match, config.seed)
    locations = locate(*given.images, given.polygons[0].centers, initial, config.global_match)
    candidates = search_candidates(*given.polygons, locations, config.global_match)
    return MatchProblem(given.images, given.polygons, initial, locations, candidates)


def seen(problem, matches):
    return verified(problem, matches, matches, LOCAL)


def exchanged(matches, first, second):
    """The matches with the partners of two left ids exchanged, which overlap little."""
    partner = {match.left: match.right for match in matches}
    partner[first], partner[second] = partner[second], partner[first]
    return [
        dataclasses.replace(m, right=partner[m.left], overlap=0.5 if m.left in (first, second) else m.overlap)
        for m in matches
    ]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("disparity", [NEAR, FAR])
@pytest.mark.parametrize("seed", [0, 1])
def test_right_matches_are_sure(preset, disparity, seed):
    given = scene(disparity, seed)
    problem = problem_of(given, PRESETS[preset])
    matches = seen(problem, match_polygons(problem, PRESETS[preset].local_match))
    assert {match.left: match.right for match in matches} == given.truth
    assert min(match.confidence for match in matches) > 0.5
    assert judged(matches, LOCAL) == (matches, [])


@pytest.mark.parametrize(("first", "second"), [(12, 13), (41, 42), (12, 52)])
def test_the_judge_rejects_planted_wrong_partners(first, second):
    """The next in the row, along the epipolar line, and one off it."""
    problem = problem_of(scene(NEAR))
    matches = exchanged(match_polygons(problem, LOCAL), first, second)
    checked = seen(problem, matches)
    kept, notes = judged(checked, LOCAL)
    assert {match.left for match in checked} - {match.left for match in kept} == {first, second}
    assert notes == [f"2 of {len(matches)} matches were rejected: less than {LOCAL.verify.min_confidence:g} sure"]
    assert judged(checked, dataclasses.replace(LOCAL, judge="off")) == (checked, [])


def test_the_next_of_equal_things_in_a_row_is_the_least_sure():
    """All things look the same: points and neighbours tell them apart."""
    given = scene(0.0)
    gray = np.tile(given.images[0].gray[:64, :64], (7, 10))
    moved = twoplanes.warp(gray, np.array([[1.01, 0.02, -22.0], [0, 1, 0], [0, 0, 1]]))
    given = dataclasses.replace(given, images=(twoplanes.image(gray), twoplanes.image(moved)))
    problem = problem_of(given)
    matches = match_polygons(problem, LOCAL)
    assert len(judged(seen(problem, matches), LOCAL)[0]) == len(matches)
    sure = {match.left: match.confidence for match in seen(problem, exchanged(matches, 12, 13))}
    doubted = sure.pop(12), sure.pop(13)
    assert max(doubted) < min(sure.values()) - 0.1


def test_light_leaves_confidence_as_it_is():
    given = scene(NEAR)
    problem = problem_of(given)
    matches = match_polygons(problem, LOCAL)
    dim = Image((given.images[1].rgb * np.linspace(0.4, 0.9, given.images[1].width)[:, None]).astype(np.uint8))
    lit = dataclasses.replace(problem, images=(given.images[0], dim))
    before, after = (np.array([m.confidence for m in seen(each, matches)]) for each in (problem, lit))
    assert np.abs(before - after).max() < 0.1


def test_without_texture_points_and_neighbours_decide():
    given = scene(NEAR)
    flat = Image(np.full_like(given.images[0].rgb, 120))
    problem = dataclasses.replace(problem_of(given), images=(flat, flat))
    matches = match_polygons(problem_of(given), LOCAL)
    sure = {m.left: m.confidence for m in seen(problem, matches)}
    doubted = {m.left: m.confidence for m in seen(problem, exchanged(matches, 12, 13))}
    assert max(doubted[12], doubted[13]) < LOCAL.verify.min_confidence < min(sure[12], sure[13])


def test_without_points_texture_and_neighbours_decide():
    given = dataclasses.replace(scene(NEAR), points=PointMatches.empty())
    problem = problem_of(given)
    matches = match_polygons(problem_of(scene(NEAR)), LOCAL)
    sure = {m.left: m.confidence for m in seen(problem, matches)}
    doubted = {m.left: m.confidence for m in seen(problem, exchanged(matches, 12, 13))}
    assert max(doubted[12], doubted[13]) < min(sure[12], sure[13])
    assert np.isfinite(list(sure.values())).all()


def test_few_matches_and_none():
    problem = problem_of(scene(NEAR))
    matches = match_polygons(problem, LOCAL)
    assert seen(problem, []) == []
    for count in (1, 2, LOCAL.verify.min_neighbors):
        some = seen(problem, matches[:count])
        assert all(0 < match.confidence < 1 for match in some)
    rows = Candidates(np.array([0]), np.array([0]))
    assert gather(problem, rows, rows, LOCAL).motion.tolist() == [LOCAL.verify.unknown_motion]


def test_the_order_of_matches_does_not_count():
    problem = problem_of(scene(NEAR))
    matches = match_polygons(problem, LOCAL)
    back = {m.left: m.confidence for m in seen(problem, matches[::-1])}
    assert {m.left: m.confidence for m in seen(problem, matches)} == pytest.approx(back, abs=1e-9)


def test_the_pair_as_a_whole_says_whether_it_shows_one_scene():
    """A cell of a large photograph may have few points: its matches are as sure as their evidence is."""
    given = scene(NEAR)
    known = problem_of(given).initial
    few = dataclasses.replace(known, points=known.points[:9], consistent=known.consistent[:9], planar=known.planar[:9])
    assert not few.supported
    assert few.same_scene < 0.1
    problem = dataclasses.replace(problem_of(given), initial=few)
    matches = seen(problem, match_polygons(problem, LOCAL))
    assert len(matches) > 40
    assert max(match.confidence for match in matches) > 0.8
    doubted = same_scene_matches(matches, few.same_scene)
    assert [(m.left, m.right) for m in doubted] == [(m.left, m.right) for m in matches]
    assert max(match.confidence for match in doubted) <= 0.1
    assert known.same_scene > 0.999
