"""A focal length from the epipolar geometry, where there is one."""

import numpy as np
import pytest
from views import SIZE, camera, rotation, views

from zpm2.config import FocalConfig
from zpm2.errors import Failed
from zpm2.model import Camera
from zpm2.pose.focal import focal_from_points

TURN = rotation(8.0, 15.0, 4.0)


def centred(focal: float) -> Camera:
    return Camera(np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]]), SIZE)


@pytest.mark.parametrize("focal", [500.0, 900.0])
@pytest.mark.parametrize("seed", range(3))
def test_focal_length(focal: float, seed: int) -> None:
    cameras = centred(focal), centred(focal)
    of = views(seed, n=400, noise=0.1, turn=TURN, shift=(-2.0, 0.8, 0.6), cameras=cameras)
    found = focal_from_points(of.points, (SIZE, SIZE), FocalConfig(), 0)
    assert not isinstance(found, Failed)
    assert abs(found[0] - focal) < max(3 * found[1], 0.02 * focal)
    assert found[1] < 0.1 * focal


def test_rectified_pairs_tell_none() -> None:
    of = views(0, n=400, noise=0.3, turn=np.eye(3), shift=(-1.0, 0, 0), cameras=(camera(), camera()))
    assert isinstance(focal_from_points(of.points, (SIZE, SIZE), FocalConfig(), 0), Failed)


def test_few_points_tell_none() -> None:
    found = focal_from_points(views(0, n=20).points, (SIZE, SIZE), FocalConfig(), 0)
    assert isinstance(found, Failed)
    assert "there are 20" in found.reason
