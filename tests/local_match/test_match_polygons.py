import dataclasses
from collections import Counter

import numpy as np
import pytest
from shapes import arrays, square
from twoplanes import Scene, scene

from zpm2.config import PRESETS, Config, LocalConfig, VisibleConfig
from zpm2.errors import Failed
from zpm2.global_match import Candidates, InitialGeometry, PyramidLocations, initial_geometry, locate, search_candidates
from zpm2.local_match import MatchProblem, match_polygons, scoring
from zpm2.model import PointMatches, PolygonArrays

PAPER = PRESETS["paper"]
NEAR, FAR = 40.0, 150.0  # px of disparity between the planes: within reach of the pyramid's window, and out of it


def run(given: Scene, config: Config = PAPER, initial: InitialGeometry | None = None):
    initial = initial or initial_geometry(given.points, config.global_match, config.seed)
    locations = locate(*given.images, given.polygons[0].centers, initial, config.global_match)
    candidates = search_candidates(*given.polygons, locations, config.global_match)
    return match_polygons(
        MatchProblem(given.images, given.polygons, initial, locations, candidates), config.local_match
    )


def pairs(matches):
    return {match.left: match.right for match in matches}


def with_local(config, **changes):
    return dataclasses.replace(config, local_match=dataclasses.replace(config.local_match, **changes))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("disparity", [NEAR, FAR])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_polygon_finds_its_own(preset, disparity, seed):
    given = scene(disparity, seed)
    matches = run(given, PRESETS[preset])
    assert pairs(matches) == given.truth
    assert [match.left for match in matches] == sorted(given.truth)
    assert len({match.right for match in matches}) == len(matches)
    for match in matches:
        assert 0.5 < match.overlap <= 1
        assert 0 < match.cost < PRESETS[preset].local_match.iota


def test_homologous_vertices_are_vertices_of_both():
    given = scene(NEAR, jitter=0.02, noise=0.0)
    left = {p.id: p for p in given.polygons[0].polygons}
    matches = run(given)
    same = total = 0
    for match in matches:
        a, b = match.nodes.T
        n = len(left[match.left].exterior)
        assert len(match.nodes) == n
        assert sorted(a) == sorted(b) == list(range(n))
        same, total = same + (a == b).sum(), total + n  # the right rings begin at the same vertex
    assert same > 0.9 * total


@pytest.mark.parametrize("preset", PRESETS)
def test_what_misled_the_pyramid_is_matched_by_the_local_stage(preset):
    given = scene(FAR, 2)
    matches = run(given, PRESETS[preset])
    stages = {match.left: match.stage for match in matches}
    assert {stages[k] for k in given.front} == {"local"}
    assert Counter(stages.values())["global"] > 30
    assert {k: v for k, v in pairs(matches).items() if k in given.front} == {k: given.truth[k] for k in given.front}


def test_without_points_texture_decides():
    given = scene(NEAR, 3)
    known = initial_geometry(given.points, PAPER.global_match, 0)
    blind = dataclasses.replace(known, points=PointMatches.empty())
    matches = run(given, initial=blind)
    assert {match.dsf for match in matches} == {0}
    wrong = [match for match in matches if given.truth.get(match.left) != match.right]
    assert len(wrong) <= 0.05 * len(given.truth)
    assert len(matches) >= 0.9 * len(given.truth)


@pytest.mark.parametrize("preset", PRESETS)
def test_the_same_image_twice_without_any_points(preset):
    given = scene(NEAR)
    twice = Scene((given.images[0],) * 2, (given.polygons[0],) * 2, PointMatches.empty(), {}, set())
    matches = run(twice, PRESETS[preset])
    assert pairs(matches) == {k: k for k in given.polygons[0].ids.tolist()}
    assert min(match.overlap for match in matches) > 0.95


def test_the_order_of_the_polygons_does_not_matter():
    given = scene(FAR, 1)
    shuffled = [list(side.polygons) for side in given.polygons]
    for side in shuffled:
        np.random.default_rng(0).shuffle(side)
    again = dataclasses.replace(given, polygons=(PolygonArrays(shuffled[0]), PolygonArrays(shuffled[1])))
    assert pairs(run(again)) == pairs(run(given))


def test_two_runs_give_the_same_numbers():
    given = scene(FAR, 4)
    first, second = run(given), run(given)
    assert len(first) == len(second) > 0
    for a, b in zip(first, second, strict=True):
        one, two = dataclasses.asdict(a), dataclasses.asdict(b)
        for array in ("nodes", "outline"):
            assert one.pop(array).tobytes() == two.pop(array).tobytes()
        assert one == two


def test_greedy_assignment_is_one_to_one_too():
    given = scene(NEAR, 5)
    matches = run(given, with_local(PAPER, assign="greedy"))
    assert len({match.right for match in matches}) == len(matches)
    right = sum(given.truth.get(k) == v for k, v in pairs(matches).items())
    assert right > 0.8 * len(given.truth)


def test_a_price_of_nothing_matches_nothing():
    assert run(scene(NEAR), with_local(PAPER, iota=0.0)) == []


def test_empty_sides():
    given, none = scene(NEAR), PolygonArrays([])
    for side in ((none, given.polygons[1]), (given.polygons[0], none), (none, none)):
        assert run(dataclasses.replace(given, polygons=side)) == []


@pytest.mark.parametrize("off", [np.nan, 5000.0])
def test_without_places_the_second_round_does_it_all(off):
    given = scene(NEAR)
    initial = initial_geometry(given.points, PAPER.global_match, 0)
    n, centers = len(given.polygons[0]), given.polygons[0].centers
    nowhere = PyramidLocations(
        centers + off, np.zeros(n, bool), np.zeros(n), np.ones(n, bool), initial.prior_locations(centers)
    )
    none = Candidates.of(np.zeros(0, np.int64), np.zeros(0, np.int64))
    matches = match_polygons(MatchProblem(given.images, given.polygons, initial, nowhere, none), PAPER.local_match)
    assert {match.stage for match in matches} == {"local"}
    assert pairs(matches) == given.truth


def test_nothing_known_but_the_polygons():
    given = scene(NEAR)
    nothing = InitialGeometry(PointMatches.empty(), Failed("no"), Failed("no"), np.zeros(0, bool), np.zeros(0, bool))
    matches = run(given, initial=nothing)
    assert len({match.right for match in matches}) == len(matches)
    assert all(np.isfinite([m.cost, m.confidence, m.overlap]).all() for m in matches)


def test_polygons_on_the_border_and_of_no_texture_do_no_harm():
    given = scene(NEAR)
    odd = [square(0, 0, 640, 448), square(639, 447, 640, 448), square(0, 0, 3, 448), square(320, 200, 321, 201)]
    extra = arrays(odd).polygons
    sides = tuple(
        PolygonArrays([*side.polygons, *(dataclasses.replace(p, id=p.id + 900) for p in extra)])
        for side in given.polygons
    )
    matches = run(dataclasses.replace(given, polygons=sides))
    assert {k: v for k, v in pairs(matches).items() if k < 900} == given.truth


def test_evaluated_pairs_grow_with_the_polygons_not_with_their_square(monkeypatch):
    evaluated = []
    evaluate = scoring.CandidateScorer.score
    monkeypatch.setattr(
        scoring.CandidateScorer,
        "score",
        lambda self, given, *rest: evaluated.append(len(given)) or evaluate(self, given, *rest),
    )
    shares = []
    for columns, rows in ((6, 5), (16, 12)):
        monkeypatch.setattr("twoplanes.COLUMNS", columns)
        monkeypatch.setattr("twoplanes.ROWS", rows)
        monkeypatch.setattr("twoplanes.SIZE", (64 * columns, 64 * rows))
        monkeypatch.setattr("twoplanes.FRONT", (3, 1, 5, 3))
        evaluated.clear()
        given = scene(NEAR, wrong=0.02)
        run(given)
        shares.append(sum(evaluated) / len(given.polygons[0]))
    assert shares[1] < 1.5 * shares[0]


@pytest.mark.parametrize("gamma", [1, 10**6])
def test_both_branches_of_the_cost_alone_find_the_polygons(gamma):
    given = scene(NEAR, 6)
    matches = run(given, with_local(PAPER, gamma=gamma))
    right = sum(given.truth.get(k) == v for k, v in pairs(matches).items())
    assert right > 0.9 * len(given.truth)
    assert LocalConfig().gamma != gamma


def test_a_polygon_cut_by_the_border_matches_by_its_visible_part_and_says_so():
    """The left polygon goes on for 60 % beyond the right image, which shows the rest at its border."""
    given = scene(NEAR, 0)
    points = given.points
    at = np.random.default_rng(1).uniform(10, 150, (200, 2))
    points = PointMatches(at, at - [60.0, 0.0], np.ones(200))
    polygons = arrays([square(0, 40, 100, 120)]), arrays([square(0, 40, 40, 120)])
    shift = np.array([[1, 0, -60.0], [0, 1, 0], [0, 0, 1]])
    every = np.ones(200, bool)
    initial = InitialGeometry(points, Failed("not looked for"), shift, every, every)
    whole = with_local(PRESETS["default"], visible=VisibleConfig(on=False), min_overlap=0.5)
    part = with_local(PRESETS["default"], min_overlap=0.5)
    given = dataclasses.replace(given, polygons=polygons)
    assert run(given, whole, initial) == []
    (match,) = run(given, part, initial)
    assert match.overlap > 0.95
    assert match.visible == pytest.approx(0.4, abs=0.05)


def test_a_polygon_behind_another_one_matches_by_its_visible_part_and_says_so():
    """A wall moves by 10 px, and a pole in front by 50: in the right image it hides half of the wall's panel."""
    given = scene(NEAR, 0)
    rng = np.random.default_rng(1)
    panel, pole = rng.uniform([62, 42], [98, 118], (60, 2)), rng.uniform([142, 42], [178, 118], (60, 2))
    points = PointMatches(np.r_[panel, pole], np.r_[panel - [10.0, 0], pole - [50.0, 0]], np.ones(120))
    polygons = (
        arrays([square(60, 40, 140, 120), square(140, 40, 180, 120)]),
        arrays([square(50, 40, 90, 120), square(90, 40, 130, 120)]),
    )
    every = np.ones(120, bool)
    initial = InitialGeometry(points, Failed("not looked for"), Failed("not looked for"), every, every)
    each = np.arange(2)
    locations = locate(*given.images, polygons[0].centers, initial, PAPER.global_match)
    problem = MatchProblem(given.images, polygons, initial, locations, Candidates(each, each))
    whole = with_local(PRESETS["default"], visible=VisibleConfig(on=False), min_overlap=0.6)
    part = with_local(PRESETS["default"], min_overlap=0.6)
    assert pairs(match_polygons(dataclasses.replace(problem, known={}), whole.local_match)) == {101: 101}
    behind, front = match_polygons(problem, part.local_match)
    assert (behind.left, behind.right, front.left, front.right) == (100, 100, 101, 101)
    assert behind.overlap > 0.95
    assert behind.visible == pytest.approx(0.5, abs=0.05)
    assert front.visible == 1


def test_a_later_round_knows_the_pairs_of_the_earlier_one(monkeypatch):
    given, config = scene(NEAR, 4), PRESETS["default"]
    initial = initial_geometry(given.points, config.global_match, config.seed)
    known = {}

    def problem(lefts, known):
        left = PolygonArrays(given.polygons[0].polygons[:lefts])
        locations = locate(*given.images, left.centers, initial, config.global_match)
        candidates = search_candidates(left, given.polygons[1], locations, config.global_match)
        return MatchProblem(given.images, (left, given.polygons[1]), initial, locations, candidates, None, known)

    compared = []
    compare = scoring.CandidateScorer._compared

    def counted(own, pairs, *more):
        compared.append(len(pairs))
        return compare(own, pairs, *more)

    monkeypatch.setattr(scoring.CandidateScorer, "_compared", counted)
    match_polygons(problem(-6, known), config.local_match)
    compared.clear()
    again = match_polygons(problem(None, known), config.local_match)
    some = sum(compared)
    compared.clear()
    fresh = match_polygons(problem(None, {}), config.local_match)
    assert 0 < some < sum(compared) / 2
    assert len(again) > 20
    assert [(m.left, m.right, m.cost, m.overlap, m.visible, m.nodes.tobytes()) for m in again] == [
        (m.left, m.right, m.cost, m.overlap, m.visible, m.nodes.tobytes()) for m in fresh
    ]


def test_matches_that_only_guide_have_no_homologous_vertices():
    given = scene(NEAR, 5)
    initial = initial_geometry(given.points, PAPER.global_match, PAPER.seed)
    locations = locate(*given.images, given.polygons[0].centers, initial, PAPER.global_match)
    candidates = search_candidates(*given.polygons, locations, PAPER.global_match)
    problem = MatchProblem(given.images, given.polygons, initial, locations, candidates)
    without = match_polygons(problem, PAPER.local_match, nodes=False)
    assert pairs(without) == pairs(run(given))
    assert {m.nodes.shape for m in without} == {(0, 2)}
