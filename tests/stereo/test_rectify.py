"""Rectified pairs: homologous points in one row, polygons and depths with them."""

import dataclasses
import re

import numpy as np
import pytest
from views import SIZE, matched, rotation, views

from zpm2.config import Config, PoseConfig, StereoConfig
from zpm2.errors import Failed
from zpm2.model import Camera, Image
from zpm2.pose import PoseFinder, PoseResult, RectifiedPair, rectify
from zpm2.stereo.rectify import rectify as stereo_rectify

PLAIN = Config(pose=PoseConfig(crops="off"))
BENT = np.array([-0.1, 0.02, 0.001, -0.001])


def images() -> tuple[Image, Image]:
    rng = np.random.default_rng(0)
    left, right = (Image(rng.integers(0, 255, (SIZE[1], SIZE[0], 3)).astype(np.uint8)) for _ in range(2))
    return left, right


def rectified(shift: tuple[float, float, float], distortion: np.ndarray | None = None) -> tuple:
    from views import camera

    cameras = None
    if distortion is not None:
        cameras = camera(700.0, distortion=distortion), camera(650.0, distortion=distortion)
    of = views(1, shift=shift, turn=rotation(3.0, 6.0, -8.0), cameras=cameras)
    result = matched(of)
    pose = PoseFinder(PLAIN)(result, of.cameras).with_baseline(float(np.linalg.norm(of.translation)))
    return of, pose, rectify(pose, images(), result.matched_polygons())


def moved(camera: Camera, rotation_: np.ndarray, original: Camera, points: np.ndarray) -> np.ndarray:
    rays = np.c_[original.rays(points), np.ones(len(points))] @ rotation_.T
    return camera.pixels(rays[:, :2] / rays[:, 2:])


@pytest.mark.parametrize("distortion", [None, BENT])
@pytest.mark.parametrize(
    ("shift", "vertical"), [((-1.0, 0.1, 0.2), False), ((1.0, 0, 0), False), ((0.1, -1.0, 0), True)]
)
def test_homologous_points_share_a_row(
    shift: tuple[float, float, float], vertical: bool, distortion: np.ndarray | None
) -> None:
    of, _, pair = rectified(shift, distortion)
    assert isinstance(pair, RectifiedPair)
    assert pair.vertical is vertical
    a = moved(pair.left.camera, pair.left.rotation, of.cameras[0], of.points.left)
    b = moved(pair.right.camera, pair.right.rotation, of.cameras[1], of.points.right)
    along, across = (1, 0) if vertical else (0, 1)
    assert np.abs(a[:, across] - b[:, across]).max() < 0.05
    # depth from the difference of the other coordinate
    k = pair.left.camera.matrix, pair.right.camera.matrix
    gap = (a[:, along] - k[0][along, 2]) - (b[:, along] - k[1][along, 2])
    depth = np.abs(k[0][0, 0] * np.linalg.norm(of.translation) / gap)
    truth = (of.world @ pair.left.rotation.T)[:, 2]
    assert np.abs(depth / truth - 1).max() < 0.01
    # and by the projections
    space = np.c_[of.world @ pair.left.rotation.T, np.ones(len(of.world))]
    for projection, seen in zip(pair.projection, (a, b), strict=True):
        p = space @ projection.T
        assert np.abs(p[:, :2] / p[:, 2:] - seen).max() < 0.1


def test_polygons_and_pixels_move_together() -> None:
    """Each matched polygon painted in a colour of its own: the rectified picture has it where the polygon is."""
    of, pose, _ = rectified((-1.0, 0.1, 0.2))
    result = matched(of)
    y, x = np.indices((SIZE[1], SIZE[0])) + 0.5
    import shapely

    label = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    for k, polygon in enumerate(result.left.polygons, 1):
        label[shapely.contains_xy(polygon.shape, x, y)] = k * 15
    painted = Image(np.repeat(label[..., None], 3, 2))
    pair = rectify(pose, (painted, painted), result.matched_polygons())
    assert isinstance(pair, RectifiedPair)
    for k, polygon in enumerate(pair.left.polygons, 1):
        column, row = np.array(polygon.shape.representative_point().coords[0]).astype(int)
        assert pair.left.image.rgb[row, column, 0] == k * 15
    assert [p.id for p in pair.left.polygons] == [p.id for p in result.left.polygons]
    assert pair.left.image.rgb.shape[:2][::-1] == pair.left.camera.size == pair.right.camera.size


def test_no_rectified_pair() -> None:
    of, pose, _ = rectified((-1.0, 0.1, 0.2))
    polygons = matched(of).matched_polygons()
    forward = views(1, shift=(0, 0, -1.0))
    along: PoseResult = PoseFinder(PLAIN)(matched(forward), forward.cameras)
    found = rectify(along, images(), polygons)
    assert isinstance(found, Failed)
    assert "line of sight" in found.reason
    turned = views(1, shift=(0, 0, 0))
    found = rectify(PoseFinder(PLAIN)(matched(turned), turned.cameras), images(), polygons)
    assert isinstance(found, Failed)
    assert "only turned" in found.reason
    found = rectify(dataclasses.replace(pose, pose=Failed("no points")), images(), polygons)
    assert isinstance(found, Failed)
    assert "no points" in found.reason


def test_the_size_of_a_rectified_pair_is_configured() -> None:
    of = views(1, shift=(-1.0, 0.1, 0.2), turn=rotation(3.0, 6.0, -8.0))
    result = matched(of)
    pose = PoseFinder(PLAIN)(result, of.cameras)
    pair = rectify(pose, images(), result.matched_polygons(), StereoConfig(rectified_size=0.5))
    assert isinstance(pair, RectifiedPair)
    assert max(pair.left.camera.size) == pytest.approx(0.5 * max(SIZE), abs=1)


def test_sides_that_cannot_be_resampled() -> None:
    k, points = np.array([[20000.0, 0, 16500], [0, 20000, 32], [0, 0, 1]]), np.array([[9000.0, 20], [20000, 40]])
    for width, config, said in (
        (33000, StereoConfig(), "photograph has a side of 33000 px, .*: reduce it"),
        (32000, StereoConfig(), "rectified image would have a side of 3.* px, .*: make stereo.rectified_size smaller"),
    ):
        view, image = Camera(k, (width, 64)), Image(np.zeros((64, width, 3), np.uint8))
        motion = rotation(0, 20, 0), np.array([-1.0, 0, 0])
        found = stereo_rectify((view, view), motion, (points, points), (image, image), ([], []), config)
        assert isinstance(found, Failed)
        assert re.search(said, found.reason)
