import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.errors import InputError
from zpm2.evaluate.ground_truth import from_disparity
from zpm2.evaluate.rendered import RenderedScene, render_scene, score_on_disparity
from zpm2.evaluate.rendered.scene import BASELINE, EYE, GAIN, PITCH
from zpm2.evaluate.rendered.still_life import WALL
from zpm2.evaluate.rendered.surfaces import Frustum, Rectangle, Sphere, box
from zpm2.model import Polygon, PolygonMatch

BLANK = np.zeros((4, 4, 3), np.uint8)
WIDTH, HEIGHT = 480, 270


@pytest.fixture(scope="module")
def scene() -> RenderedScene:
    return render_scene(0, WIDTH, HEIGHT)


def _warp(image, disparity, sign):
    """`image` as the other camera sees it."""
    h, w = disparity.shape
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    return cv2.remap(image.astype(np.float32), x + sign * disparity, y, cv2.INTER_LINEAR)


def _inner(occluded, disparity):
    """Co-visible pixels that are no neighbours of a step in depth."""
    steps = cv2.morphologyEx(disparity, cv2.MORPH_GRADIENT, np.ones((5, 5))) > 0.6
    return ~cv2.dilate((occluded | steps).astype(np.uint8), np.ones((5, 5))).astype(bool)


def test_the_right_image_warped_by_the_disparity_is_the_left_one(scene):
    for base, other, disparity, occluded, sign, gain in (
        (scene.left, scene.right, scene.disparity, scene.occluded, -1, 1 / GAIN),
        (scene.right, scene.left, scene.disparity_right, scene.occluded_right, 1, GAIN),
    ):
        inner = _inner(occluded, disparity)
        assert inner.mean() > 0.6
        bright = other.max(axis=2) < 240
        inner &= bright & (base.max(axis=2) < 240)
        error = np.abs(_warp(other, disparity, sign) * gain - base)[inner].mean()
        assert error < 6
        for wrong in (-3.0, 3.0):
            assert np.abs(_warp(other, disparity + np.float32(wrong), sign) * gain - base)[inner].mean() > 2 * error


def test_disparities_of_both_images_agree_where_both_see(scene):
    back = _warp(scene.disparity_right, scene.disparity, -1)
    inner = _inner(scene.occluded, scene.disparity)
    assert np.quantile(np.abs(back - scene.disparity)[inner], 0.99) < 0.02


def test_there_are_steps_in_depth_and_hidden_places(scene):
    steps = np.abs(np.diff(scene.disparity, axis=1)) > 2
    assert steps.sum() > HEIGHT
    assert 0.02 < scene.occluded.mean() < 0.2
    assert 0.02 < scene.occluded_right.mean() < 0.2
    interior = scene.occluded[:, int(scene.disparity.max()) + 1 :]
    assert interior.sum() > 200  # hidden behind things, not only beyond the image's border


def test_depth_is_exact_on_the_wall_and_the_occlusion_is_that_of_a_z_buffer(scene):
    up = (scene.cy - 0.5) / scene.f  # slope of the top row's rays against the optical axis, which points down by PITCH
    depth = (WALL - EYE[2]) / (np.cos(PITCH) + np.sin(PITCH) * up)
    assert np.median(scene.disparity[0]) == pytest.approx(scene.f * BASELINE / depth, abs=1e-3)
    columns, rows = from_disparity(scene.disparity, (WIDTH, HEIGHT)).left.astype(int).T
    seen = np.zeros(scene.occluded.shape, bool)
    seen[rows, columns] = True
    assert (seen == ~scene.occluded).mean() > 0.985


def test_labels_name_the_same_surface_in_both_images(scene):
    assert scene.labels.min() >= 1
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    there = np.floor(x + 0.5 - scene.disparity).astype(int)
    sure = _inner(scene.occluded, scene.disparity) & (there >= 0)
    same = scene.labels[sure] == scene.labels_right[y[sure], there[sure]]
    assert same.mean() > 0.97


def test_the_same_seed_gives_the_same_bytes_and_another_one_another_scene():
    first, again, other = (render_scene(seed, 96, 54) for seed in (3, 3, 4))
    for name in ("left", "right", "disparity", "disparity_right", "occluded", "occluded_right"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.left, other.left)
    assert not np.array_equal(first.disparity, other.disparity)


def test_every_ray_meets_something(scene):
    assert np.isfinite(scene.disparity).all()
    assert np.isfinite(scene.disparity_right).all()
    assert scene.left.shape == scene.right.shape == (HEIGHT, WIDTH, 3)
    assert scene.left.std() > 30


SURFACES = {
    "patch": Rectangle(np.array([-0.4, 0.9, 2.5]), np.array([0.8, 0.0, 0.3]), np.array([0.0, -0.7, 0.0]), BLANK),
    "disc": Rectangle(
        np.array([-0.5, 0.5, 3.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), BLANK, round=True
    ),
    "ball": Sphere(np.array([0.2, 0.4, 3.0]), 0.4, np.array([0.6, 0.8, 0.0]), BLANK),
    "cylinder": Frustum(np.array([0.1, 0.0, 2.8]), 0.6, 0.3, 0.3, BLANK),
    "cone": Frustum(np.array([0.1, 0.2, 2.8]), 0.6, 0.4, 0.15, BLANK),
}


@settings(max_examples=60)
@given(st.sampled_from(sorted(SURFACES)), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_hit_locate_and_place_agree(name, u, v):
    surface = SURFACES[name]
    points, normals = surface.place(np.array([u]), np.array([v]))
    low, high = surface.corners().min(1) - 1e-9, surface.corners().max(1) + 1e-9
    assert (points[:, 0] >= low).all()
    assert (points[:, 0] <= high).all()
    back = np.concatenate(surface.locate(points))
    assert back == pytest.approx([u, v], abs=1e-6)
    eye = np.array([[0.0], [1.5], [0.0]])
    ray = points - eye
    t = surface.hit(eye, ray)[0]
    facing = (ray * normals).sum() < -1e-6
    if name == "disc" and (u - 0.5) ** 2 + (v - 0.5) ** 2 > 0.2499:
        return
    if facing:
        assert t == pytest.approx(1, abs=1e-6)
    elif name in ("ball", "cylinder", "cone"):
        assert t < 1 + 1e-6
    else:
        assert t == np.inf


def test_a_box_shows_its_front_and_closes():
    faces = box((0, 0, 3), (1.0, 0.5, 0.8), 0.3, BLANK, BLANK)
    center = np.array([0, 0.25, 3.0])
    for face in faces:
        middle = face.place(np.array([0.5]), np.array([0.5]))[0][:, 0]
        assert face.normal @ (middle - center) > 0
    assert faces[-1].normal == pytest.approx([0, 1, 0])


def _box(index, x0, y0, x1, y1):
    return Polygon(index, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float))


def _match(left, right):
    return PolygonMatch(left, right, confidence=0.9, cost=1.0, dsf=5, stage="global")


def test_score_by_hand():
    disparity = np.full((100, 200), 10.0, np.float32)
    left = [_box(0, 50, 20, 90, 60), _box(1, 100, 20, 140, 60), _box(2, 0, 0, 9, 90)]
    right = [_box(0, 40, 20, 80, 60), _box(1, 110, 20, 150, 60), _box(2, 0, 0, 4, 2)]
    exact = score_on_disparity(left, right, [_match(0, 0)], disparity)
    assert (exact.good, exact.scored, exact.precision) == (1, 1, 1.0)
    assert exact.coverage == pytest.approx(40 * 40 / (100 * 190), rel=0.06)
    # 20 px to the right of where it belongs: 20 of 60 columns in common
    both = score_on_disparity(left, right, [_match(0, 0), _match(1, 1)], disparity)
    assert (both.good, both.scored, both.precision, both.coverage) == (1, 2, 0.5, exact.coverage)
    assert score_on_disparity(left, right, [_match(0, 0), _match(1, 1)], disparity, iou=0.3).good == 2
    # the left polygon leaves the right image, the right one is too small: nothing to judge
    assert score_on_disparity(left, right, [_match(2, 2)], disparity).scored == 0
    assert score_on_disparity(left, right, [], disparity).precision == 0
    with pytest.raises(InputError, match="match 0 - 9"):
        score_on_disparity(left, right, [_match(0, 9)], disparity)


def test_score_leaves_hidden_and_unknown_pixels_out():
    disparity = np.zeros((40, 100), np.float32)
    disparity[:, 60:80] = 20  # hides the ground at columns 40 to 59
    ground = Polygon(0, np.array([[30, 0], [60, 0], [60, 40], [30, 40]], float))
    seen = _box(0, 30, 0, 40, 40)
    assert score_on_disparity([ground], [seen], [_match(0, 0)], disparity, iou=0.85).good == 1
    unknown = np.where(np.arange(100) < 65, np.nan, disparity).astype(np.float32)
    assert score_on_disparity([ground], [seen], [_match(0, 0)], unknown).scored == 0


def test_score_respects_holes():
    disparity = np.zeros((100, 100), np.float32)
    ring = Polygon(0, _box(0, 10, 10, 90, 90).exterior, (_box(0, 20, 20, 80, 80).exterior,))
    full = _box(0, 10, 10, 90, 90)
    assert score_on_disparity([ring], [ring], [_match(0, 0)], disparity).good == 1
    assert score_on_disparity([ring], [full], [_match(0, 0)], disparity).good == 0
