"""MESA: the area graph, the cut against all subsets, and whole matchings."""

from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from region_pairs import found, grid, points, region_pair, squares
from rings import generators

from zpm2.baselines import Mesa
from zpm2.baselines.area_graph import AreaGraph, area_graph
from zpm2.baselines.mesa import cut, similarities
from zpm2.model import PolygonArrays


def test_the_area_graph():
    boxes = (0, 0, 100), (10, 10, 40), (15, 15, 10), (90, 90, 60), (100, 0, 20), (180, 180, 5)
    graph = area_graph(PolygonArrays(squares(*boxes)), contained=0.8)
    assert graph.parents == [set(), {0}, {0, 1}, set(), set(), set()]
    assert graph.children == [{1, 2}, {2}, set(), set(), set(), set()]
    assert graph.neighbours == [{3, 4}, set(), set(), {0}, {0}, set()]  # overlapping, and touching
    assert graph.iou[0][3] == graph.iou[3][0] == pytest.approx(100 / (10000 + 3600 - 100))
    assert 4 not in graph.iou[0]
    assert area_graph(PolygonArrays([]), 0.8).parents == []


@given(generators, st.integers(1, 6), st.sampled_from([0.01, 0.5, 2.0]))
def test_the_cut_is_the_least_of_all(rng, n, smoothness):
    row = {j: float(rng.uniform(0.05, 0.95)) for j in range(n)}
    iou = [{} for _ in range(n + 2)]  # two more regions have no similarity and are never taken
    for i, j in combinations(range(n + 2), 2):
        if rng.uniform() < 0.5:
            iou[i][j] = iou[j][i] = float(rng.uniform(0.1, 0.9))
    graph = AreaGraph([], [], [], iou)

    def energy(taken):
        own = sum(1 - row[j] if j in taken else row[j] for j in row)
        edges = ((i, j) for i in range(n + 2) for j in iou[i] if i < j)
        return own + smoothness * sum(iou[i][j] for i, j in edges if (i in taken) != (j in taken))

    least = min(energy(set(some)) for k in range(n + 1) for some in combinations(range(n), k))
    assert energy(set(cut(row, graph, smoothness))) == pytest.approx(least, abs=1e-4)


def test_no_similarity_no_cut():
    assert cut({}, AreaGraph([], [], [], []), 0.01) == []


def nest(x):
    return (x, 0, 100), (x + 10, 10, 40), (x + 60, 60, 30)


def test_similarity_is_the_share_of_points_both_ways():
    matches = points(grid(0, 0, 100, 10), grid(20, 0, 100, 10))
    there, back = similarities(region_pair(squares(*nest(0)), squares(*nest(20)), matches), 0.1)
    assert there[0] == pytest.approx({0: 1.0, 1: 0.16})  # the third one has 9 of 100: under the limit
    assert there[1] == pytest.approx({0: 0.16, 1: 1.0})
    assert back == there


def test_a_nest_is_matched_level_by_level():
    matches = points(grid(0, 0, 100, 10), grid(20, 0, 100, 10))
    result = found(Mesa(), region_pair(squares(*nest(0)), squares(*nest(20))[::-1], matches))
    assert set(result) == {(0, 2), (1, 1), (2, 0)}
    assert not found(Mesa(), region_pair(squares(*nest(0)), [], matches))
    assert not found(Mesa(), region_pair(squares(*nest(0)), squares(*nest(0))))


def test_relatives_decide_between_equals():
    """Two right regions share as many points with a left one; only one of them has its child inside."""
    left = squares((0, 0, 60), (10, 10, 20))
    right = squares((0, 0, 60), (5, 5, 50), (100, 100, 60), (110, 110, 20))
    child, rest = grid(10, 10, 20, 4), grid(35, 35, 15, 4)
    moved = [*(child + 100), *(rest + 100)]
    matches = points([*child, *rest, *child, *rest], [*moved, *child, *rest])
    result = found(Mesa(), region_pair(left, right, matches))
    assert (0, 2) in result
    assert (1, 3) in result
