"""Polygons cut by borders, of regions that go on beyond them."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import star

from zpm2 import geometry
from zpm2.polygons.overlap import iou
from zpm2.polygons.visible import co_visible, touched, within_borders

SIZES = (400, 300), (320, 360)
BORDER = 1 / 256


def frame(size):
    return shapely.box(0, 0, *size)


def mapped(matrix, shape):
    return shapely.transform(shape, lambda xy: geometry.project(matrix, xy))


def some_map(rng):
    turn, scale = rng.uniform(-0.6, 0.6), rng.uniform(0.7, 1.4)
    linear = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    matrix = np.eye(3)
    matrix[:2, :2] = linear
    matrix[2, :2] = rng.uniform(-3e-4, 3e-4, 2)
    matrix[:2, 2] = np.array([160, 180]) - linear @ [200, 150] + rng.uniform(-120, 120, 2)
    return matrix


def largest(shape):
    return max(shapely.get_parts(shape), key=shapely.area)


def reference(shape, matrix, size, sides):
    """One polygon, one border after the other: cut in the photograph's own frame, a grid of points there."""
    x, y = np.meshgrid(np.arange(0.5, 400), np.arange(0.5, 400))
    here = np.c_[x.ravel(), y.ravel()]
    there = geometry.project(np.linalg.inv(matrix), here)
    kept = np.ones(len(here), bool)
    for side, inside in enumerate((there[:, 0] >= 0, there[:, 1] >= 0, there[:, 0] <= size[0], there[:, 1] <= size[1])):
        if sides[side]:
            kept &= inside
    return kept & shapely.contains_xy(shape, here), shapely.contains_xy(shape, here), here


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_both_parts_of_one_region_are_the_same(seed):
    rng = np.random.default_rng(seed)
    matrix = some_map(rng)
    region = shapely.Polygon(star(rng, 9, rng.uniform([0, 0], SIZES[0]), 150.0))
    if not region.is_valid:
        return
    left = largest(shapely.intersection(region, frame(SIZES[0])))
    whole = mapped(matrix, region)
    right = shapely.intersection(whole, frame(SIZES[1]))
    common = shapely.intersection(mapped(matrix, left), right)
    if common.area < 500 or left.area < 0.98 * shapely.intersection(region, frame(SIZES[0])).area:
        return
    if not isinstance(right, shapely.Polygon) or not whole.is_valid:
        return
    pair = [np.array([shape], object) for shape in (mapped(matrix, left), right)]
    own, other = co_visible(*pair, matrix[None], np.array([left], object), SIZES, BORDER)
    assert iou(own, other)[0] > 0.97
    assert iou(own, other)[0] >= iou(*pair)[0] - 1e-9


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_the_cut_is_that_of_a_grid_of_points(seed):
    rng = np.random.default_rng(seed)
    matrix, shape = some_map(rng), shapely.Polygon(star(rng, 9, rng.uniform(80, 300, 2), 90.0))
    sides = rng.random(4) < 0.6
    inside = np.array(SIZES[0]) / 2
    cut = within_borders(np.array([shape], object), matrix[None], SIZES[0], sides[None], inside[None])[0]
    kept, all_of_it, here = reference(shape, matrix, SIZES[0], sides)
    ours = shapely.contains_xy(cut, here)
    assert np.count_nonzero(ours != kept) <= 0.02 * np.count_nonzero(all_of_it) + 8


def test_a_polygon_away_from_borders_stays_as_it_is():
    shape = np.array([shapely.box(50, 50, 90, 90)], object)
    own, other = co_visible(shape, shape, np.eye(3)[None], shape, SIZES, BORDER)
    assert own[0] is shape[0]
    assert other[0] is shape[0]


@pytest.mark.parametrize("reaches", [True, False])
def test_a_border_excuses_only_a_partner_that_touches_it(reaches):
    """The left polygon would go on to the left of the right photograph, by the map."""
    shift = np.array([[1, 0, -60.0], [0, 1, 0], [0, 0, 1]])
    left = np.array([shapely.box(20, 50, 120, 90)], object)
    right = np.array([shapely.box(0 if reaches else 5, 50, 60, 90)], object)
    own, other = co_visible(np.array([mapped(shift, left[0])]), right, shift[None], left, SIZES, BORDER)
    assert iou(own, other)[0] == pytest.approx(1.0 if reaches else 0.55)


def test_which_borders_a_polygon_touches():
    shapes = np.array([shapely.box(0, 20, 100, 299.5), shapely.box(300, 1.0, 399, 40)], object)
    assert touched(shapes, SIZES[0], BORDER).tolist() == [[True, False, False, True], [False, True, True, False]]


def test_a_degenerate_map_leaves_nothing():
    shape = np.array([shapely.box(0, 10, 50, 50)], object)
    flat = np.array([[1.0, 0, 0], [0, 0, 10], [0, 0, 1]])
    cut = within_borders(shape, flat[None], SIZES[0], np.ones((1, 4), bool), np.array([[20.0, 20.0]]))
    assert np.isfinite(shapely.area(cut)).all()
