import dataclasses

import numpy as np
import pytest
import shapely
from test_judge import LOCAL, NEAR, problem_of
from twoplanes import scene

from zpm2.global_match import Candidates
from zpm2.local_match import match_polygons
from zpm2.verify import evidence, gather


@pytest.fixture(scope="module")
def known():
    problem = problem_of(scene(NEAR))
    rows = [{int(id): row for row, id in enumerate(side.ids)} for side in problem.polygons]
    matches = match_polygons(problem, LOCAL)
    left, right = [rows[0][m.left] for m in matches], [rows[1][m.right] for m in matches]
    right[3], right[4] = right[4], right[3]
    return problem, Candidates(np.array(left), np.array(right))


def test_motion_is_the_distance_to_where_the_neighbours_take_it(known):
    problem, pairs = known
    left, right = problem.polygons
    found = gather(problem, pairs, pairs, LOCAL).motion
    for k, (i, j) in enumerate(zip(pairs.left, pairs.right, strict=True)):
        away = np.linalg.norm(left.centers[pairs.left] - left.centers[i], axis=1)
        away[k] = np.inf
        near = np.argsort(away, kind="stable")[: LOCAL.verify.neighbors]
        linear = problem.locations.prior.linear[i]
        taken = [
            right.centers[b] - linear @ (left.centers[a] - left.centers[i])
            for a, b in zip(pairs.left[near], pairs.right[near], strict=True)
        ]
        expected = np.linalg.norm(right.centers[j] - np.median(taken, axis=0)) / np.sqrt(right.areas[j])
        assert found[k] == pytest.approx(expected, abs=1e-9)
    assert found[[3, 4]].min() > 0.9
    assert np.median(found) < 0.05


def test_agreement_counts_the_points_in_both_and_in_one(known):
    problem, pairs = known
    left, right = problem.polygons
    points = problem.initial.points[problem.initial.consistent]
    found = gather(problem, pairs, pairs, LOCAL).agreement
    for k, (i, j) in enumerate(zip(pairs.left, pairs.right, strict=True)):
        inside = shapely.contains_xy(left.shapes[i], points.left), shapely.contains_xy(right.shapes[j], points.right)
        both, either = (inside[0] & inside[1]).sum(), (inside[0] | inside[1]).sum()
        assert found[k] == (both + 1) / (either + 2)
    assert found[[3, 4]].max() < 0.2


def test_width_is_that_of_the_narrower_polygon(known):
    problem, pairs = known
    shapes = [side.shapes[rows] for side, rows in zip(problem.polygons, (pairs.left, pairs.right), strict=True)]
    expected = [min(2 * shape.area / shape.length for shape in both) for both in zip(*shapes, strict=True)]
    assert gather(problem, pairs, pairs, LOCAL).width == pytest.approx(expected)


def test_a_later_problem_knows_the_evidence_of_the_pairs_of_an_earlier_one(known, monkeypatch):
    problem, pairs = known
    first, second = dataclasses.replace(problem, evidence={}), dataclasses.replace(problem, evidence={})
    some, compared, compare = pairs[np.arange(0, len(pairs), 3)], [], evidence._compared

    def counted(own, left, *more):
        compared.append(len(left))
        return compare(own, left, *more)

    monkeypatch.setattr(evidence, "_compared", counted)
    gather(first, some, pairs, LOCAL)
    again = gather(dataclasses.replace(problem, evidence=first.evidence), pairs, pairs, LOCAL)
    assert compared == [len(some), len(pairs) - len(some)]
    afresh = gather(second, pairs, pairs, LOCAL)
    for field in dataclasses.fields(afresh):
        assert getattr(again, field.name) == pytest.approx(getattr(afresh, field.name), abs=1e-12)
