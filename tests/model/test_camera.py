"""Cameras in the world."""

import numpy as np
import pytest

from zpm2.model import Camera, PosedCamera

K, SIZE = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (640, 480)


@pytest.mark.parametrize(
    ("distortion", "fold"),
    [
        ((), np.inf),
        ((0.2,), np.inf),
        ((-0.28, 0.07, 0.001, -0.001), np.inf),
        ((-0.2,), (5 / 3) ** 0.5),
        ((-0.5, 0.1), 1.0),  # it grows again from r = sqrt(2) on
        ((0, 0, 0, 0, -0.1), (10 / 7) ** (1 / 6)),
        ((0, 0, 0, 0, 0, -0.25, 0, 0), 2.0),  # the pole of r / (1 - r^2 / 4)
        ((0, 0, 0, 0, 0, 0.25, 0, 0), 2.0),
    ],
)
def test_points_beyond_the_fold_of_a_radial_distortion_have_no_pixel(distortion: tuple, fold: float) -> None:
    camera = PosedCamera(Camera(K, SIZE, np.array(distortion)), np.eye(3), np.zeros(3))
    radius = np.linspace(0, min(3 * fold, 9), 101)
    for axis in np.eye(3)[:2]:
        found = camera.project(np.c_[radius[:, None] * axis[:2], np.ones(len(radius))])
        inside = radius < fold
        assert (np.diff(found[inside] @ axis[:2]) > 0).all()
        assert np.isnan(found[~inside]).all()
    assert np.isnan(camera.project(np.array([[0.0, 0, -1], [0, 0, 0], [0.1, 0.1, -1]]))).all()
