"""The set C: which region a point has, no point twice, evenly spread."""

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from zpm2.model import PointMatches, Polygon, PolygonArrays
from zpm2.pose.points import Correspondences, region_of, spread, union


def boxes(*corners: tuple[float, float, float, float]) -> PolygonArrays:
    rings = [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64) for x0, y0, x1, y1 in corners]
    return PolygonArrays([Polygon(k, ring) for k, ring in enumerate(rings)])


def matches(left: np.ndarray, right: np.ndarray, score: np.ndarray | None = None) -> PointMatches:
    return PointMatches(left, right, np.ones(len(left)) if score is None else score)


def test_the_smallest_region_that_holds_both_ends() -> None:
    left = boxes((0, 0, 100, 100), (10, 10, 50, 50), (200, 0, 300, 100))
    right = boxes((5, 0, 105, 100), (15, 10, 55, 50), (205, 0, 305, 100))
    at = np.array([[20.0, 20], [80, 80], [250, 50], [20, 20], [400, 400]])
    to = np.array([[25.0, 20], [85, 80], [85, 80], [85, 80], [400, 400]])
    assert region_of(matches(at, to), left, right).tolist() == [1, 0, -1, 0, -1]


@given(st.integers(0, 2**32 - 1))
def test_region_of_equals_a_reading_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corner, size = rng.uniform(0, 60, (2, 6, 2)), rng.uniform(10, 50, (2, 6, 2))
    sides = [boxes(*((*c, *(c + s)) for c, s in zip(corner[k], size[k], strict=True))) for k in range(2)]
    points = matches(rng.uniform(0, 100, (40, 2)), rng.uniform(0, 100, (40, 2)))
    expected = []
    for a, b in zip(points.left, points.right, strict=True):
        holding = [
            (sides[0].areas[k], k)
            for k in range(6)
            if sides[0].shapes[k].contains(shapely.Point(a)) and sides[1].shapes[k].contains(shapely.Point(b))
        ]
        expected.append(min(holding)[1] if holding else -1)
    assert region_of(points, *sides).tolist() == expected


def test_union_says_nothing_twice() -> None:
    at = np.array([[10.0, 10], [50, 50]])
    known = Correspondences(matches(at, at, np.array([0.5, 0.9])), np.array([0, 1]), np.zeros(2, bool))
    close = np.array([[10.5, 10.5], [51, 50], [90, 90]])
    more = Correspondences(matches(close, close, np.array([0.8, 0.8, 0.8])), np.array([0, 1, 2]), np.ones(3, bool))
    both = union(known, more, 2.0)
    assert both.points.left.tolist() == [[50, 50], [10.5, 10.5], [90, 90]]
    assert both.local.tolist() == [False, True, True]
    assert both.region.tolist() == [1, 0, 2]


def test_spread_keeps_the_best_of_each_cell() -> None:
    rng = np.random.default_rng(0)
    at = rng.uniform(0, 50, (200, 2))
    points = matches(np.r_[at, [[90.0, 90], [100, 100]]], np.zeros((202, 2)), rng.random(202))
    keep = spread(points, (100, 100), 2, 5)
    assert keep[:200].sum() == 5
    assert points.score[:200][keep[:200]].min() >= np.sort(points.score[:200])[-5]
    assert keep[200:].all()
