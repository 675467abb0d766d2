import cv2
import numpy as np
import pytest
import shapely
from shapes import square

from zpm2.config import VerifyConfig
from zpm2.model import Image
from zpm2.verify.content import CHANNELS, correlations, normalised, peaks

CONFIG = VerifyConfig()
SIZE = 2 * CONFIG.patch
MIDDLE = slice(SIZE // 4, 3 * SIZE // 4)


def textured(seed, height=200, width=300, blur=1.5):
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(0, 1, (height, width)).astype(np.float32), (0, 0), blur)
    return 128 + 40 * noise / noise.std()


def image(gray):
    return Image(np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2))


def shapes(*rings):
    found = np.empty(len(rings), object)
    found[:] = [shapely.Polygon(ring) for ring in rings]
    return found


def peak(left, right, ring=None, shift=(0.0, 0.0)):
    """Of one polygon that the outlines place in both images, `shift` px apart."""
    ring = square(120, 60, 180, 120) if ring is None else ring
    maps = np.array([[[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]]], float)
    target = shapes(np.asarray(ring) + shift)
    return peaks((image(left), image(right)), target, target, maps, CONFIG, 6)[0]


def reference(left, right, inside, config):
    """The correlation at each shift, by its definition."""
    size = len(left)
    a = left[inside] - left[inside].mean()
    found = np.zeros((size, size))
    for y, x in np.ndindex(size, size):
        b = np.roll(right, (-y, -x), axis=(0, 1))[inside]
        b = b - b.mean()
        if min(a @ a, b @ b) > inside.sum() * config.min_contrast**2:
            found[y, x] = a @ b / np.sqrt((a @ a) * (b @ b))
    return found


@pytest.mark.parametrize("seed", [0, 1])
def test_correlations_are_those_of_their_definition(seed):
    rng = np.random.default_rng(seed)
    left, right = rng.normal(0, 1, (2, 16, 16)).astype(np.float32)
    right[:, 12:] = 0.5  # no contrast there
    inside = np.zeros((16, 16), bool)
    inside[4:12, 4:12] = rng.random((8, 8)) < 0.8
    found = correlations(left[None], right[None], inside[None], CONFIG)[0]
    assert found == pytest.approx(reference(left, right, inside, CONFIG), abs=2e-5)


def test_the_same_inside_is_best_in_place():
    texture = textured(0)
    assert peak(texture, texture) > 0.6
    assert peak(texture, np.roll(texture, (4, -9), axis=(0, 1)), shift=(-9, 4)) > 0.6
    assert abs(peak(texture, textured(1))) < 0.35


@pytest.mark.parametrize(("gain", "offset", "slope"), [(0.5, 60, 0), (1.3, -40, 0), (0.7, 0, 0.4), (-1.0, 255, 0)])
def test_light_does_not_count(gain, offset, slope):
    texture = textured(2)
    lit = gain * texture + offset + slope * np.arange(texture.shape[1])
    if gain > 0:
        assert peak(texture, lit) == pytest.approx(peak(texture, texture), abs=0.12)
    else:
        assert peak(texture, lit) < 0.1  # a negative of a photograph does not look alike


def test_what_moved_behind_an_outline_counts_against_it():
    """Two outlines of a gap in a fence agree; what is seen through it is elsewhere."""
    texture = textured(3)
    for shift in (8, 14, -10):
        assert peak(texture, np.roll(texture, shift, axis=1)) < 0.15 < peak(texture, texture) - 0.4


def test_repeated_texture_is_little_evidence():
    stripes = np.tile(128 + 60 * np.sin(np.arange(300) * 2 * np.pi / 12), (200, 1))
    assert abs(peak(stripes, stripes)) < 0.05
    bricks = np.tile(textured(4)[:12, :12], (17, 25))[:200, :300]
    assert peak(bricks, bricks) < peak(textured(4), textured(4)) - 0.2


@pytest.mark.parametrize("ring", [square(120, 60, 123, 63), square(-40, 60, -10, 90), square(290, 190, 340, 260)])
def test_small_and_unseen_polygons_have_a_finite_peak(ring):
    assert np.isfinite(peak(textured(5), textured(5), ring))


def test_no_texture_and_nothing_seen_say_nothing():
    flat = np.full((200, 300), 90.0)
    assert peak(flat, flat) == 0
    assert peak(textured(6), textured(6), square(-400, 60, -300, 90)) == 0
    none = peaks((image(flat), image(flat)), shapes(), shapes(), np.zeros((0, 3, 3)), CONFIG, 6)
    assert none.shape == (0,)


def test_light_is_taken_out_of_each_cell():
    rng = np.random.default_rng(7)
    patch = rng.normal(100, 20, (1, SIZE, SIZE)).astype(np.float32)
    found = normalised(patch, CONFIG)
    window = patch[0, 20 : 20 + CONFIG.light, 30 : 30 + CONFIG.light]
    middle = CONFIG.light // 2
    expected = (window[middle, middle] - window.mean()) / (window.std() + CONFIG.noise)
    assert found[0, 20 + middle, 30 + middle] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("count", [0, 1, 5, CHANNELS + 3])
def test_patches_are_normalised_one_by_one(count):
    patches = np.random.default_rng(0).uniform(0, 255, (count, 12, 12)).astype(np.float32)
    found = normalised(patches, CONFIG)
    for patch, result in zip(patches, found, strict=True):
        mean = cv2.blur(patch, (CONFIG.light, CONFIG.light))
        variance = np.maximum(cv2.blur(patch * patch, (CONFIG.light, CONFIG.light)) - mean * mean, 0)
        assert np.array_equal(result, (patch - mean) / (np.sqrt(variance) + CONFIG.noise))
