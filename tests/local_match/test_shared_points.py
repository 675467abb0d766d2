import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import arrays, square, star

from zpm2.global_match import Candidates
from zpm2.local_match import reference
from zpm2.local_match.shared_points import lookup, shared_points
from zpm2.model import PointMatches


def matches(left, right):
    return PointMatches(np.asarray(left, float), np.asarray(right, float), np.ones(len(left)))


@given(st.integers(0, 10**6), st.integers(0, 60))
@settings(max_examples=25, deadline=None)
def test_support_is_the_count_of_points_in_both(seed, n):
    rng = np.random.default_rng(seed)
    points = matches(rng.uniform(0, 100, (n, 2)), rng.uniform(0, 100, (n, 2)))
    sides = [
        arrays([star(rng, 7, rng.uniform(20, 80, 2), size) for size in (60, 40, 20, 30, 10)]) for _ in range(2)
    ]  # nested and overlapping
    found = shared_points(points, *sides)
    counts = {}
    for k, (i, j) in enumerate(zip(found.pairs.left, found.pairs.right, strict=True)):
        counts[i, j] = found.counts[k]
        for row in found.point[found.start[k] : found.start[k + 1]]:
            assert sides[0].shapes[i].covers(shapely.Point(points.left[row]))
            assert sides[1].shapes[j].covers(shapely.Point(points.right[row]))
    for i, left in enumerate(sides[0].polygons):
        for j, right in enumerate(sides[1].polygons):
            assert counts.get((i, j), 0) == reference.deep_spectral_factor(points, left, right)


def test_nested_polygons_and_holes():
    rings = [square(0, 0, 100, 100), square(20, 20, 60, 60), square(200, 200, 210, 210)]
    left = arrays(rings, [(square(70, 70, 90, 90),), (), ()])
    right = arrays(rings)
    points = matches([[10, 10], [30, 30], [80, 80], [150, 150]], [[10, 10], [30, 30], [80, 80], [205, 205]])
    found = shared_points(points, left, right)
    pairs = list(zip(found.pairs.left.tolist(), found.pairs.right.tolist(), found.counts.tolist(), strict=True))
    assert pairs == [(0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 1)]
    assert found.point.tolist() == [0, 1, 1, 1, 1]


def test_no_points_or_no_polygons():
    some, none = arrays([square(0, 0, 10, 10)]), arrays([])
    inside = matches([[5, 5]], [[5, 5]])
    for found in (
        shared_points(PointMatches.empty(), some, some),
        shared_points(inside, none, some),
        shared_points(inside, some, none),
    ):
        assert len(found.pairs) == len(found.counts) == len(found.point) == 0
        assert found.start.tolist() == [0]


@given(
    st.sets(st.tuples(st.integers(0, 6), st.integers(0, 6))), st.lists(st.tuples(st.integers(0, 6), st.integers(0, 9)))
)
def test_lookup(known, asked):
    rows = np.array(sorted(known), np.int64).reshape(-1, 2)
    wanted = np.array(asked, np.int64).reshape(-1, 2)
    values = 10 + np.arange(len(rows))
    got = lookup(values, Candidates(rows[:, 0], rows[:, 1]), Candidates(wanted[:, 0], wanted[:, 1]))
    table = {tuple(row): value for row, value in zip(rows.tolist(), values.tolist(), strict=True)}
    assert got.tolist() == [table.get(pair, -1) for pair in asked]
