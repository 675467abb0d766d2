"""Photographs of two textured boards, one before the other, from cameras that are known exactly."""

from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from rendered import photograph

from zpm2.geometry import HALF_PIXEL
from zpm2.model import Camera, PosedCamera

SIZE = 480, 360
CAMERA = Camera(np.array([[480.0, 0, 240], [0, 480, 180], [0, 0, 1]]), SIZE)
FAR, NEAR = 4.0, 3.0  # z of the boards
TEXEL = 0.005  # size of a pixel of a board


def cameras(count: int = 4) -> list[PosedCamera]:
    """In a row, turned inwards a little."""
    found = []
    for x in np.linspace(-0.45, 0.45, count):
        turn = cv2.Rodrigues(np.array([0, x / 6, 0.02 * x]))[0]
        found.append(PosedCamera(CAMERA, turn, -turn @ np.array([x, 0.05 * x, 0.0])))
    return found


def seen(camera: PosedCamera) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) what a camera sees, and (h, w) its depth."""
    far, near = _textures()
    picture, depth = None, None
    for texture, z, low in ((far, FAR, (-3.0, -2.25)), (near, NEAR, (-0.75, -0.75))):
        board = np.array([[TEXEL, 0, low[0]], [0, TEXEL, low[1]], [0, 0, z]])  # texture px -> world, times (u, v, 1)
        to_image = camera.camera.matrix @ (camera.rotation @ board + np.outer(camera.translation, [0, 0, 1]))
        matrix = np.linalg.inv(HALF_PIXEL) @ to_image @ HALF_PIXEL
        drawn = cv2.warpPerspective(texture, matrix, SIZE, flags=cv2.INTER_LINEAR)
        covered = cv2.warpPerspective(np.ones(texture.shape[:2], np.uint8), matrix, SIZE, flags=cv2.INTER_NEAREST) > 0
        x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
        rays = camera.directions(np.c_[x.ravel(), y.ravel()])[:, 2].reshape(y.shape)
        here = (z - camera.center[2]) / rays
        picture = drawn if picture is None else np.where(covered[..., None], drawn, picture)
        depth = here if depth is None else np.where(covered, here, depth)
    assert picture is not None
    assert depth is not None
    return picture, depth


def write(folder: Path, count: int = 4) -> list[Path]:
    """The photographs as files."""
    folder.mkdir(parents=True)
    paths = [folder / f"{k}.png" for k in range(count)]
    for path, content in zip(paths, _files(count), strict=True):
        path.write_bytes(content)
    return paths


@cache
def _textures() -> tuple[np.ndarray, np.ndarray]:
    return photograph(1, 1200, 900), photograph(2, 300, 300)


@cache
def _files(count: int) -> list[bytes]:
    files = [BytesIO() for _ in range(count)]
    for file, camera in zip(files, cameras(count), strict=True):
        PIL.Image.fromarray(seen(camera)[0]).save(file, "png")
    return [file.getvalue() for file in files]


def coarse(patch: pytest.MonkeyPatch, depth: int = 8) -> None:
    """Meshes of the command line with an octree of `depth` levels, which takes a second instead of ten."""
    pycolmap = pytest.importorskip("pycolmap")
    mesh = pycolmap.poisson_meshing

    def shallow(points: Any, file: Any, options: Any) -> None:
        options.depth = depth
        mesh(points, file, options)

    patch.setattr(pycolmap, "poisson_meshing", shallow)
