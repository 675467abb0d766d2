import cv2
import numpy as np
import pytest
import shapely
from shapes import square, star

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates
from zpm2.local_match import texture as module
from zpm2.local_match.texture import TexturePatches, correlation
from zpm2.model import Image

SIZE = 24
MIN_CONTRAST = LocalConfig().min_contrast
HALVINGS = LocalConfig().max_halvings
SIDE = 300
IDENTITY = np.eye(3)[None]
CORNER = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # to OpenCV's pixel centres at 0


def grain(seed=0, sigma=2.5):
    noise = np.random.default_rng(seed).normal(0, 1, (SIDE, SIDE)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), sigma)
    return 128 + 25 * noise / noise.std()


def image(gray):
    return Image(np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2))


def shapes(*rings):
    result = np.empty(len(rings), object)
    result[:] = [shapely.Polygon(ring) for ring in rings]
    return result


def r(first, second, left=None, right=None, to_left=IDENTITY):
    frame = shapes(star(np.random.default_rng(1), 9, (150, 140), 50)) if left is None else left
    a = TexturePatches(image(first), frame, to_left, SIZE, HALVINGS)
    b = TexturePatches(image(second), frame if right is None else right, IDENTITY, SIZE, HALVINGS)
    return correlation((a, b), Candidates(np.zeros(1, np.int64), np.zeros(1, np.int64)), MIN_CONTRAST)[0]


def test_the_same_texture():
    assert r(grain(), grain()) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(("gain", "offset"), [(0.4, 90), (1.3, -40)])
def test_brightness_and_contrast_do_not_matter(gain, offset):
    assert r(grain(), gain * grain() + offset) > 0.99


def test_a_negative_is_negative():
    assert r(grain(), 256 - grain()) < -0.99


def test_other_texture_and_no_texture():
    assert abs(r(grain(0), grain(1))) < 0.35
    assert r(grain(), np.full((SIDE, SIDE), 100.0)) == 0
    assert r(np.full((SIDE, SIDE), 100.0), grain()) == 0


def test_only_what_the_polygons_cover_counts():
    gray, spoilt = grain(), grain(5)
    inside = cv2.fillPoly(np.zeros((SIDE, SIDE), np.uint8), [np.round(square(100, 100, 200, 200)).astype(int)], 1) > 0
    spoilt[inside] = gray[inside]
    diamond = np.array([[150, 105], [195, 150], [150, 195], [105, 150.0]])
    assert r(gray, spoilt, shapes(diamond)) == pytest.approx(1, abs=1e-6)
    outside = np.where(inside, 0, gray)
    assert r(gray, outside, shapes(square(100, 100, 200, 300))) < 0.9


def test_a_hole_does_not_count():
    gray, spoilt = grain(), grain()
    spoilt[130:170, 130:170] = grain(5)[130:170, 130:170]
    frame = np.empty(1, object)
    frame[0] = shapely.Polygon(square(100, 100, 200, 200), [square(122, 122, 178, 178)])
    assert r(gray, spoilt, frame) == pytest.approx(1, abs=1e-6)
    assert r(gray, spoilt, shapes(square(100, 100, 200, 200))) < 0.97


@pytest.mark.parametrize("degrees", [30, -75, 180])
def test_a_rotated_pair_is_seen_through_the_rectified_frame(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    center = np.array([[1, 0, 150], [0, 1, 150], [0, 0, 1.0]])
    to_right = center @ turn @ np.linalg.inv(center)
    left = grain()
    right = cv2.warpPerspective(left, CORNER @ to_right @ np.linalg.inv(CORNER), (SIDE, SIDE), flags=cv2.INTER_CUBIC)
    ring = star(np.random.default_rng(2), 9, (150, 150), 60)
    frame = shapes(ring @ to_right[:2, :2].T + to_right[:2, 2])
    assert r(left, right, frame, to_left=np.linalg.inv(to_right)[None]) > 0.9
    assert abs(r(left, right, shapes(ring), frame)) < 0.5


def test_large_polygons_are_sampled_without_aliasing():
    stripes = np.broadcast_to(128 + 100.0 * (np.arange(SIDE) % 2), (SIDE, SIDE))
    patches = TexturePatches(image(stripes), shapes(square(20, 20, 280, 280)), IDENTITY, SIZE, HALVINGS)
    assert patches.values[0].std() < 12


def test_nothing_of_an_empty_or_outside_frame_is_seen():
    frames = np.array([shapely.Polygon(), shapely.box(400, 400, 450, 450), shapely.box(-50, 100, 50, 200)])
    patches = TexturePatches(image(grain()), frames, np.repeat(IDENTITY, 3, axis=0), SIZE, HALVINGS)
    assert patches.inside.sum(1).tolist() == [0, 0, SIZE**2 / 2]
    pairs = Candidates(np.array([0, 1]), np.array([0, 1]))
    assert correlation((patches, patches), pairs, MIN_CONTRAST).tolist() == [0, 0]
    none = TexturePatches(image(grain()), frames[:0], np.zeros((0, 3, 3)), SIZE, HALVINGS)
    assert none.values.shape == (0, SIZE**2)
    assert len(correlation((none, none), pairs[np.zeros(0, np.intp)], MIN_CONTRAST)) == 0


def test_parts_do_not_show(monkeypatch):
    rng = np.random.default_rng(0)
    frames = shapes(*[star(rng, 7, rng.uniform(60, 240, 2), size) for size in (50, 9, 100, 30, 140)])
    maps = np.repeat(IDENTITY, 5, axis=0)
    i, j = (rows.ravel() for rows in np.meshgrid(np.arange(5), np.arange(5)))

    def both():
        first, second = (
            TexturePatches(image(grain()), frames, maps, SIZE, HALVINGS),
            TexturePatches(image(grain(1)), frames, maps, SIZE, HALVINGS),
        )
        return first.values, correlation((first, second), Candidates(i, j), MIN_CONTRAST)

    values, whole = both()
    monkeypatch.setattr(module, "PATCH_CELLS", 2 * SIZE**2)
    monkeypatch.setattr(module, "PAIR_CHUNK", 3)
    again, parts = both()
    assert np.array_equal(values, again)
    assert parts == pytest.approx(whole)
