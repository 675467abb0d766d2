import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import carried, fundamental, image, known, texture, translation, turn

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.global_match import PyramidLocations, locate, reference
from zpm2.global_match.pyramid import correlate, level_count, sample_templates, subpixel_peaks

CONFIG = GlobalConfig()
QUICK = GlobalConfig(top_size=100, phi=9, tau=12)  # for the slow reference
HEIGHT, WIDTH = 480, 640
seeds = st.integers(0, 10**6)


def grid(step=70, margin=60):
    x, y = np.arange(margin, WIDTH - margin, step), np.arange(margin, HEIGHT - margin, step)
    return np.array([0.3, 0.8]) + np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def pair(homography, seed=0):
    gray = texture(HEIGHT, WIDTH, seed)
    return image(gray), image(carried(gray, homography))


def within(points, margin=25):
    return ((points >= margin) & (points <= [WIDTH - margin, HEIGHT - margin])).all(1)


@given(st.integers(1, 20000), st.integers(1, 20000))
def test_downsampling_stops_as_the_paper_says(width, height):
    n, side = level_count(width, height, CONFIG), min(width, height)
    assert side / CONFIG.factor**n <= CONFIG.top_size * (1 + 1e-12)
    assert n == 0 or side / CONFIG.factor ** (n - 1) > CONFIG.top_size


@given(seeds, st.integers(3, 12), st.integers(0, 12))
@settings(max_examples=25, deadline=None)
def test_correlate_is_the_direct_correlation(seed, t, more):
    rng = np.random.default_rng(seed)
    area = (rng.uniform(0, 255, (3, t + more, t + more)) + 1000).astype(np.float32)
    template = rng.uniform(0, 255, (3, t, t)).astype(np.float32)
    area[2, more : more + t, :t] = 900 + 0.5 * template[2]
    fast = correlate(area, template)
    for m in range(3):
        for y in range(more + 1):
            for x in range(more + 1):
                window = area[m, y : y + t, x : x + t].astype(np.float64)
                assert fast[m, y, x] == pytest.approx(reference.ncc(window, template[m]), abs=1e-5)
    assert fast[2, more, 0] == pytest.approx(1.0, abs=1e-5)


def test_correlate_without_texture_is_zero():
    area = np.full((2, 20, 20), 131.0, np.float32)
    template = np.random.default_rng(0).uniform(0, 255, (2, 7, 7)).astype(np.float32)
    assert not correlate(area, template).any()
    assert not correlate(template, np.full((2, 7, 7), 9.0, np.float32)).any()


@given(st.floats(0.6, 10.4), st.floats(0.6, 10.4), st.floats(1e-4, 0.01), st.floats(1e-4, 0.01))
def test_peak_of_a_parabola_is_exact(x0, y0, a, b):
    at = np.arange(12)
    peak, value = subpixel_peaks((0.9 - a * (at - x0) ** 2 - b * (at[:, None] - y0) ** 2)[None])
    assert peak[0] == pytest.approx([x0, y0], abs=1e-6)
    assert 0.9 - (a + b) / 4 - 1e-12 <= value[0] <= 0.9


def test_peak_at_a_border_stays_on_the_pixel():
    at = np.arange(12)
    score = 0.9 - 0.01 * (at + 0.3) ** 2 - 0.01 * (at[:, None] - 5.25) ** 2
    forbidden = np.where(at[:, None] < 5, -2.0, score)
    peak, _ = subpixel_peaks(np.stack([score, score.T, forbidden, np.full((12, 12), 0.5)]))
    assert peak == pytest.approx(np.array([[0, 5.25], [5.25, 0], [0, 5], [0, 0]]))


@given(seeds, st.booleans(), st.booleans())
@settings(max_examples=8, deadline=None)
def test_fast_is_the_reference(seed, with_f, with_h):
    rng = np.random.default_rng(seed)
    gray = texture(220, 310, seed)
    gray[80:150, 100:180] = 90
    truth = turn(rng.uniform(-12, 12), rng.uniform(0.9, 1.1), np.array([155.0, 110.0]), rng.uniform(-9, 9, 2))
    guess = translation(*rng.uniform(-8, 8, 2)) @ truth
    images = image(gray), image(carried(gray, truth))
    centers = np.r_[rng.uniform((0, 0), (310, 220), (14, 2)), [[140.0, 115.0], [2.0, 3.0]]]
    initial = known(fundamental(truth) if with_f else None, guess if with_h else None)
    fast, plain = (f(*images, centers, initial, QUICK) for f in (locate, reference.locate))
    assert np.array_equal(fast.found, plain.found)
    assert np.array_equal(fast.outside, plain.outside)
    assert fast.centers == pytest.approx(plain.centers, abs=0.01)
    assert fast.correlation == pytest.approx(plain.correlation, abs=1e-3)  # of patches without much contrast in float32


@given(seeds, st.floats(-30, 30), st.floats(-12, 12))
@settings(max_examples=6, deadline=None)
def test_known_shift_to_a_fraction_of_a_pixel(seed, dx, dy):
    truth, centers = translation(dx, dy), grid()
    locations = locate(*pair(truth, seed), centers, known(fundamental(truth), translation(dx + 7, dy - 5)), CONFIG)
    error = np.linalg.norm(locations.centers - centers - [dx, dy], axis=1)
    assert locations.found.all()
    assert np.median(error) < 0.25
    assert error.max() < 0.8
    assert locations.correlation.min() > 0.9


@pytest.mark.parametrize("degrees", [-40, 15, 40])
def test_rotation_scale_and_a_homography_that_is_off(degrees):
    truth = turn(degrees, 1.1, np.array([WIDTH, HEIGHT]) / 2, (8.0, -4.0))
    truth[2, :2] = 1e-4, -5e-5
    centers = grid()
    exact = geometry.project(truth, centers)
    centers, exact = centers[within(exact)], exact[within(exact)]
    locations = locate(*pair(truth), centers, known(fundamental(truth), translation(5, 6) @ truth), CONFIG)
    error = np.linalg.norm(locations.centers - exact, axis=1)
    assert len(centers) > 15
    assert locations.found.mean() > 0.95
    assert np.median(error) < 0.5


def test_without_the_affine_part_of_h_a_rotated_pair_does_not_correlate():
    truth = turn(40, 1.0, np.array([WIDTH, HEIGHT]) / 2)
    centers = grid()[within(geometry.project(truth, grid()))]
    images = pair(truth)
    template = sample_templates(images[0].gray, centers, np.broadcast_to(truth[:2, :2], (len(centers), 2, 2)), 15)
    plain = sample_templates(images[0].gray, centers, np.broadcast_to(np.eye(2), (len(centers), 2, 2)), 15)
    seen = sample_templates(
        images[1].gray, geometry.project(truth, centers), np.broadcast_to(np.eye(2), (len(centers), 2, 2)), 15
    )
    assert np.median(correlate(seen, template)) > 0.9
    assert np.median(correlate(seen, plain)) < 0.6


def test_without_fundamental_matrix_or_homography():
    truth, centers = translation(-11.4, 3.7), grid()
    images = pair(truth)
    for initial in (known(h=translation(-5, 0)), known(f=fundamental(truth)), known()):
        locations = locate(*images, centers, initial, CONFIG)
        assert locations.found.all()
        assert np.median(np.linalg.norm(locations.centers - centers - truth[:2, 2], axis=1)) < 0.15


def test_the_epipolar_band_is_kept():
    truth, centers = translation(-11.0, 0.0), grid()
    wrong = fundamental(translation(-11.0, 9.0))  # every epipolar line 9 px too low
    locations = locate(*pair(truth), centers, known(wrong, translation(-11.0, 9.0)), CONFIG)
    distance = geometry.epipolar_distance(wrong, centers, locations.centers)
    assert distance[locations.found].max(initial=0) <= CONFIG.band + 0.8


def test_no_texture_falls_back_to_the_prediction_and_says_so():
    truth = translation(-10.0, 0.0)
    gray = texture(HEIGHT, WIDTH, 3)
    gray[140:340, 220:420] = 100
    centers = np.array([[320.0, 240.0], [80.0, 80.0]])
    guess = translation(-14.0, 3.0)
    locations = locate(image(gray), image(carried(gray, truth)), centers, known(h=guess), CONFIG)
    assert locations.found.tolist() == [False, True]
    assert locations.centers[0] == pytest.approx([306.0, 243.0])
    assert locations.correlation[0] == 0
    assert not locations.outside.any()


def test_places_outside_of_the_right_image_are_flagged():
    centers = np.array([[20.0, 240.0], [320.0, 240.0], [WIDTH - 20.0, 240.0]])
    far = translation(300.0, 0.0)
    locations = locate(*pair(far), centers, known(h=far), CONFIG)
    assert locations.outside.tolist() == [False, False, True]
    assert locations.found.tolist() == [True, True, False]
    assert locations.centers[2] == pytest.approx([WIDTH + 280.0, 240.0])


def test_behind_the_horizon_there_is_no_place():
    h = np.eye(3)
    h[2, 0] = -1 / 400
    locations = locate(*pair(np.eye(3)), np.array([[500.0, 200.0], [10.0, 10.0]]), known(h=h), CONFIG)
    assert np.isnan(locations.centers[0]).all()
    assert np.isfinite(locations.centers[1]).all()
    assert locations.outside[0]
    assert not locations.found[0]


def test_fixed_search_takes_the_predicted_place():
    h = translation(12.0, 5.0)
    locations = locate(*pair(h), grid(), known(h=h), dataclasses.replace(CONFIG, search="fixed"))
    assert locations.centers == pytest.approx(grid() + np.array([12, 5]))
    assert not locations.found.any()


def test_nothing_to_place_and_images_smaller_than_the_template():
    assert locate(*pair(np.eye(3)), np.zeros((0, 2)), known(), CONFIG).centers.shape == (0, 2)
    tiny = image(texture(6, 5, 0))
    locations = locate(tiny, tiny, np.array([[2.0, 3.0]]), known(), CONFIG)
    assert not locations.found[0]
    assert locations.centers[0] == pytest.approx([2, 3])


def test_chunks_do_not_show(monkeypatch):
    truth, initial = translation(4.0, 2.0), known(h=translation(2.0, 1.0))
    images = pair(truth)
    whole = locate(*images, grid(), initial, CONFIG)
    monkeypatch.setattr("zpm2.global_match.pyramid.CORRELATION_CHUNK", 5)
    parts = locate(*images, grid(), initial, CONFIG)
    assert parts.centers == pytest.approx(whole.centers, abs=1e-9)
    assert np.array_equal(parts.found, whole.found)


@pytest.mark.parametrize("first", [0, 1, 7])
def test_some_after_the_others_are_where_all_are_together(first):
    truth, initial = translation(4.0, 2.0), known(h=translation(2.0, 1.0))
    images = pair(truth)
    whole = locate(*images, grid(), initial, CONFIG)
    parts = (locate(*images, centers, initial, CONFIG) for centers in (grid()[:first], grid()[first:]))
    joined = PyramidLocations.join(*parts)
    assert joined.centers == pytest.approx(whole.centers, abs=1e-9)
    assert joined.correlation == pytest.approx(whole.correlation, abs=1e-6)
    assert np.array_equal(joined.found, whole.found)
    assert np.array_equal(joined.outside, whole.outside)
    assert joined.prior.centers == pytest.approx(whole.prior.centers, abs=1e-9)
    assert joined.prior.linear == pytest.approx(whole.prior.linear, abs=1e-9)
