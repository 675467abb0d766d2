import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from zpm2.model import Polygon, PolygonArrays, shapes_of

SQUARE = np.array([[2.0, 1], [12, 1], [12, 11], [2, 11]])
HOLE = np.array([[4.0, 3], [4, 7], [6, 7], [6, 3]])


def test_measures_of_a_square_with_a_hole():
    polygon = Polygon(3, SQUARE, (HOLE,))
    assert polygon.area == 100 - 8
    assert polygon.bounds == (2, 1, 12, 11)
    assert polygon.shape.is_valid
    assert len(polygon.shape.interiors) == 1
    assert polygon.center == pytest.approx([(7 * 100 - 5 * 8) / 92, (6 * 100 - 5 * 8) / 92])


def test_defaults_say_nothing_is_known():
    polygon = Polygon(0, SQUARE)
    assert (polygon.holes, polygon.score, polygon.parent, polygon.label) == ((), 1.0, None, None)


@given(st.integers(-50, 50), st.integers(-50, 50), st.integers(0, 3))
def test_area_and_centre_follow_a_shift_and_do_not_know_the_first_vertex(x, y, first):
    shift = np.array([x, y], float)
    polygon, moved = Polygon(0, SQUARE), Polygon(1, np.roll(SQUARE, first, axis=0) + shift)
    assert moved.area == polygon.area
    assert moved.center == pytest.approx(polygon.center + shift)


def test_arrays_are_the_polygons_in_their_order():
    polygons = [Polygon(9, SQUARE, (HOLE,)), Polygon(4, SQUARE[:3] + 20)]
    arrays = PolygonArrays(polygons)
    assert len(arrays) == 2
    assert arrays.ids.tolist() == [9, 4]
    for k, polygon in enumerate(polygons):
        assert arrays.areas[k] == polygon.area
        assert arrays.centers[k] == pytest.approx(polygon.center)
        assert tuple(arrays.bounds[k]) == polygon.bounds
        assert isinstance(arrays.shapes[k], shapely.Polygon)


def test_no_polygons_are_arrays_of_the_right_shape():
    arrays = PolygonArrays([])
    assert len(arrays) == 0
    assert (arrays.centers.shape, arrays.bounds.shape, arrays.areas.shape) == ((0, 2), (0, 4), (0,))
    assert arrays.ids.dtype == np.int64


def test_shapes_made_together_are_those_made_one_by_one():
    polygons = [Polygon(0, SQUARE, (HOLE,)), Polygon(1, SQUARE[:3]), Polygon(2, SQUARE + 20, (HOLE + 20, HOLE + 23))]
    known = polygons[1].shape
    for shape, polygon in zip(shapes_of(polygons), polygons, strict=True):
        assert shape.equals_exact(shapely.Polygon(polygon.exterior, polygon.holes))
        assert polygon.shape is shape
    assert polygons[1].shape is known
    assert shapes_of([]).shape == (0,)
