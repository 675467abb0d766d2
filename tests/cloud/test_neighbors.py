"""Which views are matched."""

import cv2
import numpy as np
import pytest
from clouds import CAMERA, looking_down
from meshes import grid, sphere

from zpm2.cloud import SurfaceMesh, neighbor_pairs
from zpm2.cloud.rays import EveryTriangle
from zpm2.config import CloudConfig
from zpm2.errors import InputError
from zpm2.model import Camera, PosedCamera


def test_views_in_a_row_are_matched_with_those_beside_them() -> None:
    surface = grid(6)
    cameras = [looking_down(x, 0.0, 3.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)]
    pairs = neighbor_pairs(cameras, surface, EveryTriangle(surface), CloudConfig(neighbors=1))
    assert {(0, 1), (3, 4)} <= set(pairs)
    assert all(b - a == 1 for a, b in pairs)
    both = neighbor_pairs(cameras, surface, EveryTriangle(surface), CloudConfig(neighbors=2))
    assert {(0, 1), (1, 2), (2, 3), (3, 4)} <= set(both)


def test_the_back_of_a_thing_is_no_neighbor_of_its_front() -> None:
    ball = sphere(2)
    front = [looking_down(-0.3, 0.0, 3.0), looking_down(0.3, 0.0, 3.0)]
    turn = np.diag([1.0, -1.0, -1.0])  # the world turned upside down
    back = [PosedCamera(CAMERA, c.rotation @ turn, c.translation) for c in front]
    pairs = neighbor_pairs([*front, *back], ball, EveryTriangle(ball), CloudConfig(neighbors=3))
    assert set(pairs) == {(0, 1), (2, 3)}


def test_views_past_the_fold_of_a_distortion_are_no_neighbors() -> None:
    """From inside a ball, 75 degrees apart: r d(r) folds some of what one view sees into the other one's image."""
    ball, bent = sphere(3), Camera(CAMERA.matrix, CAMERA.size, np.array([-0.2]))
    turns = [cv2.Rodrigues(np.radians([0, angle, 0]))[0] for angle in (0.0, 75.0)]
    cameras = [PosedCamera(bent, turn, np.array([0.03 * k, 0, 0])) for k, turn in enumerate(turns)]
    assert neighbor_pairs(cameras, ball, EveryTriangle(ball), CloudConfig()) == []


def test_no_view_sees_the_mesh() -> None:
    away = SurfaceMesh.of(grid(2).vertices + np.array([100.0, 0, 0]), grid(2).faces)
    cameras = [looking_down(0, 0, 3.0), looking_down(0.1, 0, 3.0)]
    with pytest.raises(InputError, match="same coordinates"):
        neighbor_pairs(cameras, away, EveryTriangle(away), CloudConfig(neighbors=2))
