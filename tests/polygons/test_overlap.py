import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapes import arrays, star

from zpm2.polygons.overlap import iou, may_reach, shared_box


def some_shapes(seed: int, count: int = 40) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        arrays([star(rng, 7, rng.uniform(0, 60, 2), rng.uniform(1, 30)) for _ in range(count)]).shapes for _ in range(2)
    ]


@given(st.integers(0, 10**6), st.floats(0.01, 1))
def test_what_cannot_reach_the_least_overlap_is_not_intersected(seed: int, least: float) -> None:
    first, second = some_shapes(seed)
    exact, bounded = iou(first, second), iou(first, second, least)
    assert (bounded[exact >= least] == exact[exact >= least]).all()
    assert ((bounded == exact) | (bounded == 0)).all()
    assert (bounded <= exact).all()


def test_each_pair_has_its_own_least_overlap() -> None:
    box, half = shapely.box(0, 0, 10, 10), shapely.box(0, 0, 5, 10)
    first, second = np.array([box] * 4, object), np.array([half, half, box, shapely.box(20, 0, 30, 10)], object)
    assert iou(first, second, np.array([0.5, 0.51, 1.0, 0.0])).tolist() == [0.5, 0.0, 1.0, 0.0]


def test_bounds_share_no_area_with_nothing() -> None:
    shapes = np.array(
        [shapely.box(0, 0, 4, 4), shapely.Polygon(), shapely.box(4, 0, 8, 4), shapely.box(2, 2, 8, 8)], object
    )
    bounds, areas = shapely.bounds(shapes), shapely.area(shapes)
    shared = shared_box(bounds[[0, 0, 0, 0]], bounds)
    assert shared[[0, 2, 3]].tolist() == [16.0, 0.0, 4.0]
    assert np.isnan(shared[1])
    reach = may_reach((areas[[0] * 4], areas), (bounds[[0] * 4], bounds), 0.08)
    assert reach.tolist() == [True, False, False, True]
