from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.model import Image
from zpm2.photos.sampling import bilinear, levels, pyramid


def blob(height, width, at, sigma):
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    return (200 * np.exp(-((x - at[0]) ** 2 + (y[:, None] - at[1]) ** 2) / (2 * sigma**2))).astype(np.float32)


def centroid(image):
    weights = image / image.sum(dtype=np.float64)
    x, y = np.arange(image.shape[1]) + 0.5, np.arange(image.shape[0]) + 0.5
    return np.array([(weights * x).sum(), (weights * y[:, None]).sum()])


@given(
    st.integers(230, 331),
    st.integers(230, 331),
    st.floats(0.45, 0.55),
    st.floats(0.45, 0.55),
    st.sampled_from([2, 3, 4]),
)
@settings(max_examples=25, deadline=None)
def test_pyramid_keeps_the_outer_corner_origin(height, width, u, v, factor):
    at = np.array([u * width, v * height])
    for k, level in enumerate(pyramid(blob(height, width, at, 14.0), 2, factor)):
        assert centroid(level) == pytest.approx(at / factor**k, abs=0.01)


@given(st.integers(1, 200), st.integers(1, 200), st.integers(0, 4), st.integers(2, 5))
@settings(max_examples=25, deadline=None)
def test_pyramid_sizes_round_up_and_a_constant_stays(height, width, levels, factor):
    images = pyramid(np.full((height, width), 77.0, np.float32), levels, factor)
    assert len(images) == levels + 1
    for fine, coarse in pairwise(images):
        assert coarse.shape == tuple(-(-side // factor) for side in fine.shape)
    assert all(np.abs(image - 77).max() < 1e-3 for image in images)


@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(1, 30))
@settings(max_examples=25, deadline=None)
def test_bilinear_is_exact_on_a_linear_image_and_repeats_the_border(seed, height, width):
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(-3, 3, 3)
    image = (a * np.arange(width) + b * np.arange(height)[:, None] + c).astype(np.float32)
    at = rng.uniform(-5, 35, (4, 6, 2))
    clipped = np.clip(at, 0, [width - 1, height - 1])
    values = bilinear(image, at[..., 0], at[..., 1])
    assert values.shape == (4, 6)
    assert values.dtype == np.float32
    assert values == pytest.approx(a * clipped[..., 0] + b * clipped[..., 1] + c, abs=1e-3)


def test_bilinear_at_pixel_centres_is_the_pixel():
    image = np.random.default_rng(0).uniform(0, 255, (7, 9)).astype(np.float32)
    assert np.array_equal(bilinear(image, *np.meshgrid(np.arange(9.0), np.arange(7.0))), image)
    assert np.array_equal(bilinear(image, np.arange(9.0)[None], np.arange(7.0)[:, None]), image)


def test_the_levels_of_a_photograph_are_computed_once():
    image = Image(np.random.default_rng(1).integers(0, 255, (70, 90, 3), np.uint8))
    first = levels(image, 1, 2)
    for found, expected in zip(levels(image, 3, 2), pyramid(image.gray, 3, 2), strict=True):
        assert np.array_equal(found, expected)
    assert levels(image, 1, 2)[1] is first[1]
    assert np.array_equal(levels(image, 1, 3)[1], pyramid(image.gray, 1, 3)[1])
