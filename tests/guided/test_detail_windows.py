"""Where to look closer."""

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from zpm2 import config, geometry
from zpm2.global_match import InitialGeometry
from zpm2.guided import windows
from zpm2.model import Image, PointMatches

CONFIG = config.assign(config.preset("default"), ["segment.detail.min_side=32"])
SIZE = (400, 300)


def seen_through(h: np.ndarray, size: tuple[int, int] = SIZE) -> InitialGeometry:
    at = np.random.default_rng(0).uniform(0, size, (2000, 2))
    there = geometry.project(h, at)
    inside = ((there >= 0) & (there < size)).all(1)
    points = PointMatches(at[inside], there[inside], np.ones(int(inside.sum())))
    every = np.ones(len(points), bool)
    return InitialGeometry(points, np.zeros((3, 3)), h, every, every)


def grey(size: tuple[int, int] = SIZE) -> Image:
    return Image(np.full((size[1], size[0], 3), 90, np.uint8))


def part_of(h: np.ndarray) -> windows.SharedPart:
    return windows.shared_part((grey(), grey()), seen_through(h), CONFIG)


def zoom(factor: float, x: float, y: float) -> np.ndarray:
    """The right image shows the left one around (x, y) enlarged."""
    return np.array([[factor, 0, SIZE[0] / 2 - factor * x], [0, factor, SIZE[1] / 2 - factor * y], [0, 0, 1]])


SAME = zoom(1, 200, 150)


@pytest.mark.parametrize(("h", "bounds"), [(SAME, (0, 0, 400, 300)), (zoom(4, 200, 150), (150, 112.5, 250, 187.5))])
def test_the_shared_part_is_what_the_right_image_shows(h: np.ndarray, bounds: tuple[float, ...]) -> None:
    part, cell = part_of(h), 400 / CONFIG.segment.detail.cells
    assert np.abs(shapely.total_bounds(part.cells) - bounds).max() <= cell
    assert shapely.area(part.cells).sum() == pytest.approx(shapely.box(*bounds).area, rel=0.3)


def test_a_pair_that_shares_nothing_has_no_part() -> None:
    part = part_of(np.array([[1, 0, 1000.0], [0, 1, 0], [0, 0, 1]]))
    assert part.covered(np.zeros(0, object)) == 1.0
    assert windows.candidates(part, CONFIG) == []


@pytest.mark.parametrize("factor", [0.4, 1.0, 1.5, 4.0])
def test_zoom_is_the_larger_scale_by_the_smaller_one(factor: float) -> None:
    turned = turn(30.0) @ zoom(factor, 200, 150)
    assert part_of(turned).zoom == pytest.approx(max(factor, 1 / factor), rel=0.02)
    assert part_of(np.array([[1, 0, 1000.0], [0, 1, 0], [0, 0, 1]])).zoom == 1.0


def turn(degrees: float) -> np.ndarray:
    """About the middle of the right image."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = SIZE[0] / 2, SIZE[1] / 2
    return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y], [0, 0, 1]])


def test_coverage_counts_what_both_show() -> None:
    part = part_of(zoom(2, 200, 150))  # x 100 to 300
    assert part.covered(np.array([shapely.box(0, 0, 200, 300)], object)) == pytest.approx(0.5, abs=0.05)
    assert part.covered(np.array([shapely.box(0, 0, 90, 300)], object)) == 0
    assert part.covered(np.zeros(0, object)) == 0


def test_a_part_that_is_small_in_one_image_is_a_window_of_its_own() -> None:
    assert len(windows.candidates(part_of(zoom(4, 200, 150)), CONFIG)[0]) == 1
    assert len(windows.candidates(part_of(zoom(0.25, 200, 150)), CONFIG)[0]) == 1  # small in the right one
    assert len(windows.candidates(part_of(SAME), CONFIG)[0]) == 4


@given(st.floats(0.3, 4), st.floats(50, 350), st.floats(50, 250))
def test_windows_show_the_same_scene_within_both_images(factor: float, x: float, y: float) -> None:
    h = zoom(factor, x, y)
    part = part_of(h)
    for halving in windows.candidates(part, CONFIG):
        for window in halving:
            for box in (window.left, window.right):
                assert 0 <= box[0] < box[2] <= SIZE[0]
                assert 0 <= box[1] < box[3] <= SIZE[1]
            cells = part.cells[shapely.within(part.cells, shapely.box(*window.left))]
            there = geometry.project(h, shapely.get_coordinates(shapely.centroid(cells)))
            there = np.minimum(there, np.nextafter(SIZE, 0.0))  # a centre may lie on the image's border
            assert windows.inside(there, window.right).all()


def test_windows_of_one_halving_cover_the_part() -> None:
    high = config.assign(CONFIG, ["segment.detail.level=high"])
    part = part_of(SAME)
    found = windows.candidates(part, high)
    assert [len(each) for each in found] == [4, 16]
    for each in found:
        assert shapely.union_all([shapely.box(*window.left) for window in each]).area == 400 * 300


def test_windows_that_show_nothing_new_are_left_out() -> None:
    short = config.assign(CONFIG, ["segment.detail.min_side=250"])
    assert windows.candidates(part_of(SAME), short) == [[]]


def dots(places: list[tuple[int, int]]) -> Image:
    pixels = np.full((300, 400, 3), 90, np.uint8)
    for x, y in places:
        pixels[y - 3 : y + 3, x - 3 : x + 3] = 220
    return Image(pixels)


def test_blobs_are_open_where_no_matched_region_of_their_size_is() -> None:
    places = [(60, 60), (200, 60), (200, 150), (340, 240)]
    part = part_of(zoom(1.5, 200, 150))  # x 67 to 333, y 50 to 250
    matched = [shapely.box(197, 147, 203, 153), shapely.box(150, 30, 250, 100)]
    found = windows.open_blobs(dots(places), part, np.array(matched, object), CONFIG)
    near = {place: np.hypot(*(found - place).T).min(initial=np.inf) < 4 for place in places}
    assert near == {(60, 60): False, (200, 60): True, (200, 150): False, (340, 240): False}


def test_pixels_without_data_hold_no_blobs() -> None:
    image = dots([(100, 100), (300, 200)])
    valid = np.ones((300, 400), bool)
    valid[:, 200:] = False
    found = windows.open_blobs(dataclasses.replace(image, valid=valid), part_of(SAME), np.zeros(0, object), CONFIG)
    assert len(found)
    assert found[:, 0].max() < 200
