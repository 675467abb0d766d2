import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from zpm2 import geometry
from zpm2.config import Config, LocalConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.model import PointMatches, Polygon, PolygonArrays
from zpm2.tiled import cells as geometry_cells
from zpm2.tiled.cells import local_geometry, uncertainty, warped_by_cells

CONFIG = Config()
SIDE = 256
MOTIONS = [
    np.array([[1.0, 0.02, 30], [-0.02, 1, 5], [0, 0, 1]]),
    np.array([[0, -0.8, 2000], [0.8, 0, 100], [0, 0, 1.0]]),
]
CELLS = CONFIG.tiles.cells
HALF = 2000  # px, where one motion ends


def cells(arrays, points, side, config):
    sized = dataclasses.replace(config, tiles=dataclasses.replace(config.tiles, size=side))
    return geometry_cells.cells(arrays, points, sized)


def polygons(boxes):
    shapes = [shapely.box(x, y, x + w, y + h) for x, y, w, h in boxes]
    return PolygonArrays([Polygon(10 + k, shapely.get_coordinates(s.exterior)[:-1]) for k, s in enumerate(shapes)])


def mosaic(n, seed=0, low=(0, 0), high=(2 * HALF, 1500), noise=0.2):
    rng = np.random.default_rng(seed)
    left = rng.uniform(low, high, (n, 2))
    right = np.where(left[:, :1] < HALF, *(geometry.project(m, left) for m in MOTIONS))
    return PointMatches(left, right + rng.normal(0, noise, (n, 2)), np.ones(n))


boxes = st.tuples(st.integers(0, 5000), st.integers(0, 5000), st.integers(1, 3000), st.integers(1, 3000))


@given(st.lists(boxes, min_size=1, max_size=30), st.sampled_from([256, 1024]))
def test_every_polygon_is_in_one_cell_with_its_like(given, side):
    arrays = polygons(given)
    found = list(cells(arrays, PointMatches.empty(), side, CONFIG))
    assert sorted(np.concatenate([cell.rows for cell in found]).tolist()) == list(range(len(arrays)))
    for cell in found:
        longer = (arrays.bounds[cell.rows, 2:] - arrays.bounds[cell.rows, :2]).max(1)
        assert (longer / cell.reduction <= side / 4 + 1e-6).all()
        assert cell.reduction == 1 or (longer * 2 / cell.reduction > side / 4 - 1e-6).all()
        assert cell.reduction & (cell.reduction - 1) == 0
        assert np.ptp(arrays.centers[cell.rows], axis=0).max() <= side * cell.reduction
    same = {}
    for cell in found:
        place = tuple(np.floor(arrays.centers[cell.rows[0]] / (side * cell.reduction)))
        assert same.setdefault((cell.reduction, place), cell) is cell  # no two cells of one place


def test_no_polygons():
    assert list(cells(PolygonArrays([]), mosaic(100), SIDE, CONFIG)) == []


def test_each_side_of_a_scene_has_its_own_geometry():
    centers = np.array([(x, y) for x in range(100, 4000, 300) for y in range(100, 1400, 300)])
    arrays = polygons([(x, y, 40, 30) for x, y in centers])
    found = list(cells(arrays, mosaic(8000), SIDE, CONFIG))
    assert len(found) > 30
    checked = 0
    for cell in found:
        middle = arrays.centers[cell.rows].mean(0, keepdims=True)
        if abs(middle[0, 0] - HALF) < 1.5 * SIDE:
            continue
        checked += 1
        wanted = geometry.project(MOTIONS[int(middle[0, 0] > HALF)], middle)
        assert np.abs(geometry.project(cell.initial.homography, middle) - wanted).max() < 1.5
        own = np.abs(cell.initial.points.left - middle).max()
        assert own < 2 * SIDE
    assert checked > 20
    warped = warped_by_cells(arrays, found, CONFIG.local_match)
    for k, center in enumerate(arrays.centers):
        if abs(center[0] - HALF) > 1.5 * SIDE:
            motion = MOTIONS[int(center[0] > HALF)]
            wanted = shapely.transform(arrays.shapes[k], lambda xy, m=motion: geometry.project(m, xy))
            assert warped.shapes[k].intersection(wanted).area > 0.8 * wanted.area
    assert warped.own.sum() > 0


def test_points_of_another_place_say_nothing():
    arrays = polygons([(100, 100, 40, 30)])
    (cell,) = cells(arrays, mosaic(500, 1, low=(3 * SIDE, 0)), SIDE, CONFIG)
    assert len(cell.initial.points) == 0
    assert shapely.is_empty(warped_by_cells(arrays, [cell], LocalConfig(gamma=8)).shapes).all()


def test_where_points_are_few_the_nearest_ones_count():
    arrays = polygons([(100, 100, 40, 30)])
    near = mosaic(150, low=(1.6 * SIDE, 1.6 * SIDE), high=(1.95 * SIDE, 1.95 * SIDE))
    far = mosaic(500, 1, low=(3000, 0))
    (cell,) = cells(arrays, PointMatches.join([far, near]), SIDE, CONFIG)
    assert len(cell.initial.points) == CELLS.min_points
    assert cell.initial.points.left.max() < 900
    wanted = geometry.project(MOTIONS[0], arrays.centers)
    assert np.abs(geometry.project(cell.initial.homography, arrays.centers) - wanted).max() < 5
    (all_there_are,) = cells(arrays, mosaic(30, high=(SIDE, SIDE)), SIDE, CONFIG)
    assert len(all_there_are.initial.points) == 30
    (one,) = cells(arrays, mosaic(1, high=(SIDE, SIDE)), SIDE, CONFIG)
    assert len(one.initial.points) == 1
    assert isinstance(one.initial.homography, Failed)


def test_without_points_there_is_no_geometry_and_no_place():
    arrays = polygons([(100, 100, 40, 30), (3000, 100, 500, 500)])
    found = list(cells(arrays, PointMatches.empty(), SIDE, CONFIG))
    assert [type(cell.initial.homography) for cell in found] == [Failed] * 2
    assert [type(cell.initial.fundamental) for cell in found] == [Failed] * 2
    assert not any(cell.initial.supported for cell in found)
    warped = warped_by_cells(arrays, found, CONFIG.local_match)
    assert shapely.is_empty(warped.shapes).all()
    assert warped.own.tolist() == [0, 0]
    assert len(warped_by_cells(PolygonArrays([]), [], LocalConfig(gamma=8))) == 0


def test_many_points_are_thinned_evenly():
    points = mosaic(5 * CELLS.max_points + 7)
    initial = local_geometry(points, CONFIG)
    assert CELLS.max_points <= len(initial.points) < 1.5 * CELLS.max_points
    assert np.array_equal(initial.points.left, points.left[::5])


@pytest.mark.parametrize("relief", [30.0, 60.0])
def test_where_no_homography_holds_it_is_the_affine_map_of_most(relief):
    """Relief so strong that no 6 px hold: too few points agree."""
    rng = np.random.default_rng(0)
    left = rng.uniform(0, 2000, (40, 2))
    points = PointMatches(left, left + 100 + rng.uniform(-relief, relief, (40, 2)), np.ones(40))
    strict = dataclasses.replace(CONFIG, global_match=dataclasses.replace(CONFIG.global_match, homography_px=1e-3))
    initial = local_geometry(points, strict)
    assert not isinstance(initial.homography, Failed)
    middle = np.array([[1000.0, 1000.0]])
    assert np.abs(geometry.project(initial.homography, middle) - middle - 100).max() < 2 * relief
    same = local_geometry(points, strict)
    assert np.array_equal(initial.homography, same.homography)


def test_points_on_a_line_or_in_one_place_give_a_geometry_or_none_but_no_error():
    line = np.c_[np.arange(50.0), np.arange(50.0)]
    for left in (line, np.full((50, 2), 3.0), line[:3]):
        homography = local_geometry(PointMatches(left, left + 5, np.ones(len(left))), CONFIG).homography
        assert isinstance(homography, Failed) or np.isfinite(homography).all()


@pytest.mark.parametrize("noise", [0.5, 4.0, 30.0])
def test_uncertainty_is_how_far_neighbours_lead_astray(noise):
    rng = np.random.default_rng(0)
    left = rng.uniform(0, 1000, (800, 2))
    right = left @ np.array([[0.9, 0.1], [-0.1, 1.1]]).T + [300, 20] + rng.normal(0, noise, (800, 2))
    points, everything = PointMatches(left, right, np.ones(800)), np.ones(800, bool)
    none = Failed("none")
    h = np.array([[0.9, 0.1, 300], [-0.1, 1.1, 20], [0, 0, 1]])
    known = InitialGeometry(points, none, h, everything, everything)
    assert noise < uncertainty(known, CELLS) < 4 * noise
    assert uncertainty(known, CELLS) < uncertainty(InitialGeometry(points, none, none, everything, everything), CELLS)
    few = InitialGeometry(
        points[np.arange(CELLS.neighbors)], none, h, everything[: CELLS.neighbors], everything[: CELLS.neighbors]
    )
    assert uncertainty(few, CELLS) == np.inf
