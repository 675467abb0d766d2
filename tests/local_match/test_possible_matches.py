import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from twoplanes import scene

from zpm2.config import PRESETS, LocalConfig
from zpm2.global_match import initial_geometry, locate, search_candidates
from zpm2.local_match import MatchProblem, match_polygons, one_to_one, possible_matches
from zpm2.local_match.reference import assign_exhaustive
from zpm2.model import PolygonArrays, PolygonMatch


def stages(given, config):
    initial = initial_geometry(given.points, config.global_match, config.seed)
    locations = locate(*given.images, given.polygons[0].centers, initial, config.global_match)
    candidates = search_candidates(*given.polygons, locations, config.global_match)
    return MatchProblem(given.images, given.polygons, initial, locations, candidates), config.local_match


def values(match):
    return (match.left, match.right, match.cost, match.confidence, match.dsf, match.stage, match.overlap)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("disparity", [40.0, 150.0])
def test_they_contain_what_is_matched(preset, disparity):
    config = PRESETS[preset]
    asked = stages(scene(disparity), config)
    matched, possible = match_polygons(*asked), possible_matches(*asked)
    assert {values(m) for m in matched} <= {values(m) for m in possible}
    assert all(0 < m.cost < config.local_match.iota for m in possible)
    assert len({(m.left, m.right) for m in possible}) == len(possible)
    chosen = one_to_one(possible, config.local_match)
    assert [values(m) for m in chosen] == [values(m) for m in matched]
    nodes = {(m.left, m.right): m.nodes for m in possible}
    assert all(np.array_equal(m.nodes, nodes[m.left, m.right]) for m in matched)


def test_a_polygon_may_be_in_several():
    given = scene(40.0)
    double = [dataclasses.replace(p, id=1000 + p.id, exterior=p.exterior + 2.0) for p in given.polygons[1].polygons]
    both = dataclasses.replace(
        given, polygons=(given.polygons[0], PolygonArrays([*given.polygons[1].polygons, *double]))
    )
    possible = possible_matches(*stages(both, PRESETS["paper"]))
    first = {m.left for m in possible if m.right < 1000} & {m.left for m in possible if m.right >= 1000}
    assert len(first) > 0.9 * len(given.truth)
    chosen = one_to_one(possible, PRESETS["paper"].local_match)
    assert len({m.left for m in chosen}) == len({m.right for m in chosen}) == len(chosen) >= len(given.truth)


def test_empty_sides():
    given, none = scene(40.0), PolygonArrays([])
    for side in ((none, given.polygons[1]), (given.polygons[0], none), (none, none)):
        empty = dataclasses.replace(given, polygons=side)
        assert possible_matches(*stages(empty, PRESETS["paper"])) == []
    assert one_to_one([], LocalConfig()) == []


costs = st.dictionaries(st.tuples(st.integers(0, 4), st.integers(0, 4)), st.floats(0.05, 8.0), max_size=9)


@given(costs, st.sampled_from([0.5, 2.0, 5.0]), st.randoms(use_true_random=False))
@settings(max_examples=150)
def test_one_to_one_is_the_optimum_over_all_of_them(prices, iota, random):
    """Of several blocks, in any order; the ids are no rows."""
    pairs = list(prices.items())
    random.shuffle(pairs)
    matches = [PolygonMatch(70 - 3 * i, 900 + 11 * j, 0.5, cost, 3, "global") for (i, j), cost in pairs]
    chosen = one_to_one(matches, dataclasses.replace(LocalConfig(), iota=iota))
    assert [m.left for m in chosen] == sorted({m.left for m in chosen})
    assert len({m.right for m in chosen}) == len(chosen)
    assert all(any(m is given for given in matches) for m in chosen)
    energy = sum(m.cost for m in chosen) + iota * (len({m.left for m in matches}) - len(chosen))
    assert energy == pytest.approx(assign_exhaustive(prices, iota)[0])
