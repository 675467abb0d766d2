"""Polygons carried by points of known geometry."""

import dataclasses
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import arrays, square, star

from zpm2 import geometry
from zpm2.config import LocalConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons import local_homography
from zpm2.polygons.overlap import iou
from zpm2.polygons.warp import WarpingPoints, warp_by_points

CONFIG = LocalConfig(gamma=8)
H = np.array([[0.9, 0.1, 30.0], [-0.1, 1.1, 5.0], [1e-4, -5e-5, 1.0]])


def points(left, map_=H):
    return PointMatches(left, geometry.project(map_, left), np.ones(len(left)))


def truth(polygons, map_=H):
    return np.array([shapely.Polygon(geometry.project(map_, p.exterior)) for p in polygons.polygons], object)


def some_polygons(rng, n=12):
    return arrays([star(rng, 9, rng.uniform(80, 400, 2), 40.0) for _ in range(n)])


def test_many_points_of_its_own_carry_a_polygon_exactly():
    rng = np.random.default_rng(0)
    polygons = some_polygons(rng)
    warped = warp_by_points(polygons, points(rng.uniform(0, 500, (6000, 2))), Failed("not looked for"), CONFIG)
    assert (warped.own >= CONFIG.gamma).all()
    assert len(warped) == len(polygons)
    assert iou(warped.shapes, truth(polygons)).min() > 0.995


def test_outliers_do_not_carry_it_away():
    rng = np.random.default_rng(1)
    polygons, known = some_polygons(rng), points(rng.uniform(0, 500, (6000, 2)))
    wrong = rng.random(len(known)) < 0.2
    known.right[wrong] = rng.uniform(0, 500, (wrong.sum(), 2))
    assert iou(warp_by_points(polygons, known, H, CONFIG).shapes, truth(polygons)).min() > 0.95


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_an_affine_pair_is_exact_whatever_the_points(seed, n):
    rng = np.random.default_rng(seed)
    affine = np.array([[1.1, 0.2, -20.0], [-0.15, 0.9, 12.0], [0, 0, 1]])
    polygons = some_polygons(rng, 5)
    warped = warp_by_points(polygons, points(rng.uniform(0, 500, (n, 2)), affine), affine, CONFIG)
    assert iou(warped.shapes, truth(polygons, affine)).min() > 0.999


def test_without_points_of_its_own_the_nearest_ones_say_how_it_moves():
    polygons = arrays([square(100, 100, 140, 140), square(400, 400, 440, 440)])
    rng = np.random.default_rng(2)
    beside_first, beside_second = (
        rng.uniform(150, 180, (CONFIG.nearest_points, 2)),
        rng.uniform(450, 480, (CONFIG.nearest_points, 2)),
    )
    known = PointMatches(
        np.concatenate([beside_first, beside_second]),
        np.concatenate([beside_first + np.array([7, 0]), beside_second + np.array([-20, 3])]),
        np.ones(2 * CONFIG.nearest_points),
    )
    warped = warp_by_points(polygons, known, Failed("none"), CONFIG)
    assert list(warped.own) == [0, 0]
    assert warped.shapes[0].bounds == pytest.approx((107, 100, 147, 140))
    assert warped.shapes[1].bounds == pytest.approx((380, 403, 420, 443))


def test_a_few_points_of_its_own_outvote_the_neighbours():
    polygons = arrays([square(100, 100, 140, 140)])
    own, others = np.array([[110.0, 110], [120, 130], [130, 115]]), np.array([[150.0, 120]] * 20)
    known = PointMatches(
        np.concatenate([own, others]),
        np.concatenate([own + np.array([30, 0]), others + np.array([2, 0])]),
        np.ones(len(own) + 20),
    )
    warped = warp_by_points(polygons, known, Failed("none"), CONFIG)
    assert warped.own[0] == 3
    assert warped.shapes[0].bounds == pytest.approx((130, 100, 170, 140))


def test_without_any_point_there_is_no_saying():
    warped = warp_by_points(arrays([square(0, 0, 9, 9)]), PointMatches.empty(), H, CONFIG)
    assert warped.shapes[0].is_empty
    assert len(warp_by_points(arrays([]), points(np.ones((3, 2))), H, CONFIG)) == 0


def test_beyond_the_horizon_there_is_no_shape():
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [-0.01, 0, 1]])  # points of x >= 100 lie beyond it
    polygons = arrays([square(20, 10, 130, 30)])
    inside = np.random.default_rng(4).uniform((20, 10), (90, 30), (200, 2))
    known = points(inside, tilted)
    assert warp_by_points(polygons, known, tilted, CONFIG).shapes[0].is_empty


def test_backwards_undoes_forwards():
    rng = np.random.default_rng(3)
    known = points(rng.uniform(0, 500, (3000, 2)))
    consistent = np.ones(len(known), bool)
    consistent[::7] = False
    initial = InitialGeometry(known, Failed("none"), H, consistent, consistent)
    polygons = some_polygons(rng)
    there = warp_by_points(polygons, *initial.forward(), CONFIG)
    back = warp_by_points(
        arrays([shapely.get_coordinates(s.exterior)[:-1] for s in there.shapes]), *initial.backward(), CONFIG
    )
    assert len(initial.forward()[0]) == len(initial.backward()[0]) == consistent.sum()
    assert iou(back.shapes, polygons.shapes).min() > 0.99


def test_a_polygon_is_warped_once_and_alone_as_among_others(monkeypatch):
    rng = np.random.default_rng(7)
    polygons, known = some_polygons(rng, 20), points(rng.uniform(0, 500, (900, 2)))
    whole = warp_by_points(polygons, known, H, CONFIG)
    kept = WarpingPoints.of(known)
    warp_by_points(PolygonArrays(polygons.polygons[3:9]), kept, H, CONFIG)
    again = warp_by_points(polygons, kept, H, CONFIG)
    assert again.maps.tobytes() == whole.maps.tobytes()
    assert shapely.to_wkb(again.shapes).tolist() == shapely.to_wkb(whole.shapes).tolist()
    assert again.own.tolist() == whole.own.tolist()
    monkeypatch.setattr(local_homography, "fit_homographies", None)
    renumbered = PolygonArrays([dataclasses.replace(p, id=p.id + 7, parent=1) for p in polygons.polygons])
    assert warp_by_points(renumbered, kept, H, CONFIG).maps.tobytes() == whole.maps.tobytes()


def test_another_geometry_or_configuration_warps_again():
    rng = np.random.default_rng(8)
    polygons, kept = some_polygons(rng), WarpingPoints.of(points(rng.uniform(0, 500, (40, 2))))
    first = warp_by_points(polygons, kept, Failed("none"), CONFIG)
    assert (warp_by_points(polygons, kept, H, CONFIG).maps != first.maps).any()
    few = LocalConfig(gamma=8, nearest_points=1)
    fresh = warp_by_points(polygons, points(kept.left), Failed("none"), few)
    assert warp_by_points(polygons, kept, Failed("none"), few).maps.tobytes() == fresh.maps.tobytes()


def test_copies_of_points_know_nothing():
    rng = np.random.default_rng(9)
    polygons, kept = some_polygons(rng), WarpingPoints.of(points(rng.uniform(0, 500, (40, 2))))
    warp_by_points(polygons, kept, H, CONFIG)
    moved = dataclasses.replace(kept, right=kept.right + 5.0)
    for copied in (pickle.loads(pickle.dumps(kept)), moved):
        assert not copied.known
        assert np.array_equal(copied.left, kept.left)
    assert not np.allclose(
        warp_by_points(polygons, moved, H, CONFIG).maps, warp_by_points(polygons, kept, H, CONFIG).maps
    )
