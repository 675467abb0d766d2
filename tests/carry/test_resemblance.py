"""Both photographs in the place of a region."""

import cv2
import numpy as np
import pytest
import shapely

from zpm2 import config, geometry
from zpm2.carry.places import Places
from zpm2.carry.resemblance import Resemblance, correlations, one_plane, resemblance
from zpm2.global_match import initial_geometry
from zpm2.model import Image, PointMatches

CONFIG = config.preset("default")
H = np.array([[0.9, 0.1, 12.0], [-0.1, 0.95, 20.0], [1e-4, 0, 1]])
SIZE = 200
CELLS = np.array([shapely.box(x, y, x + 30, y + 24) for y in (30, 80, 130) for x in (30, 80, 130)], object)


def texture(seed, size=SIZE):
    rough = np.random.default_rng(seed).uniform(0, 255, (size, size)).astype(np.float32)
    return 128 + 4 * (cv2.GaussianBlur(rough, (0, 0), 2) - 128)


def photograph(grey):
    return Image(np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, 2))


def found(maps):
    moved = [
        shapely.transform(cell, lambda xy, m=m: geometry.project(m, xy)) for cell, m in zip(CELLS, maps, strict=True)
    ]
    n = len(CELLS)
    return Places(np.array(moved, object), maps, np.full(n, 0.5), np.full(n, 4), np.full(n, 0.1), np.ones(n))


PLACES = found(np.tile(H, (len(CELLS), 1, 1)))
LEFT = texture(0)
HALF = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
RIGHT = cv2.warpPerspective(LEFT, np.linalg.inv(HALF) @ H @ HALF, (SIZE, SIZE))


def pair_geometry():
    at = np.random.default_rng(3).uniform(20, SIZE - 20, (300, 2))
    points = PointMatches(at, geometry.project(H, at), np.ones(len(at)))
    return initial_geometry(points, CONFIG.global_match, CONFIG.seed)


def test_the_same_surface_correlates_and_another_does_not():
    assert correlations((photograph(LEFT), photograph(RIGHT)), PLACES, CONFIG).min() > 0.9
    assert correlations((photograph(LEFT), photograph(texture(1))), PLACES, CONFIG).max() < 0.5


def test_the_values_are_those_of_pixels_compared_one_by_one():
    (value, *_) = correlations((photograph(LEFT), photograph(RIGHT)), PLACES, CONFIG)
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    inside = shapely.contains_xy(PLACES.shapes[0], x + 0.5, y + 0.5)
    back = geometry.project(np.linalg.inv(H), np.c_[x[inside], y[inside]] + 0.5) - 0.5
    there = cv2.remap(LEFT, *(c.astype(np.float32)[None] for c in back.T), cv2.INTER_LINEAR)[0]
    assert value == pytest.approx(np.corrcoef(there, RIGHT[inside])[0, 1], abs=0.03)


def test_without_texture_or_place_nothing_is_known():
    grey = photograph(np.full((SIZE, SIZE), 90.0))
    assert np.isnan(correlations((grey, grey), PLACES, CONFIG)).all()
    flat = found(np.tile(np.array([[0.0, 0, 50], [0, 0, 60], [0, 0, 1]]), (len(CELLS), 1, 1)))
    assert np.isnan(correlations((photograph(LEFT), photograph(RIGHT)), flat, CONFIG)).all()


def test_other_light_is_no_doubt():
    images = photograph(LEFT), photograph(0.5 * RIGHT + 20)
    assert resemblance(images, PLACES, pair_geometry(), CONFIG).values.min() > 0.9


def test_a_pair_that_never_correlates_much_doubts_its_regions_less():
    noise = np.random.default_rng(5).normal(0, 60, (SIZE, SIZE))
    images = photograph(LEFT), photograph(RIGHT + noise)
    alone = correlations(images, PLACES, CONFIG)
    assert np.all(resemblance(images, PLACES, pair_geometry(), CONFIG).values > alone)


def test_trust_rises_where_the_photographs_agree_and_falls_where_they_do_not():
    values = np.array([np.nan, 0.5, 1.0, 0.0, 0.75, 0.25, 0.4, 0.6, 0.9])
    trust = Resemblance(values, 1.0).trust(PLACES, CONFIG.carry)
    assert trust[:3].tolist() == [0.5, 0.5, 1.0]
    assert trust[3] == pytest.approx(0.5 * (1 - CONFIG.carry.doubt))
    assert trust[4] == pytest.approx(0.75)
    assert np.all((trust >= 0) & (trust <= 1))
    assert np.all(trust[[5, 6]] < 0.5)
    assert np.all(trust[[7, 8]] > 0.5)


def test_photographs_that_resemble_each_other_nowhere_say_little():
    images = photograph(LEFT), photograph(texture(1))
    found = resemblance(images, PLACES, pair_geometry(), CONFIG)
    assert found.power < 0.5
    assert resemblance((photograph(LEFT), photograph(RIGHT)), PLACES, pair_geometry(), CONFIG).power == 1
    values = np.zeros(len(CELLS))
    told = [Resemblance(values, power).trust(PLACES, CONFIG.carry) for power in (0.0, 0.5, 1.0)]
    assert np.all(told[0] == PLACES.trust)
    assert np.all((told[2] < told[1]) & (told[1] < told[0]))


def test_a_moved_outline_is_as_exact_as_the_photographs_or_else_the_points_say():
    geometry_of_pair, values = pair_geometry(), np.where(np.arange(len(CELLS)) % 2, 0.9, 0.1)
    clear, dark = (Resemblance(values, power).exact(PLACES, geometry_of_pair, CONFIG.carry) for power in (1.0, 0.0))
    assert clear == pytest.approx(one_plane(geometry_of_pair) * np.where(values > 0.5, 0.9, 0.0))
    assert dark == pytest.approx(one_plane(geometry_of_pair) * PLACES.trust)


def test_one_plane():
    assert one_plane(pair_geometry()) > 0.95
    assert one_plane(initial_geometry(PointMatches.empty(), CONFIG.global_match, CONFIG.seed)) == 0
