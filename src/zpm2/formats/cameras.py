"""Cameras from files of data sets and other programs, in our frame: pixel centres at +0.5, X_cam = R X_world + t."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from zpm2.errors import InputError
from zpm2.files.listing import existing, text
from zpm2.files.reading import read_arrays
from zpm2.geometry import HALF_PIXEL

Array = NDArray[np.float64]
MAX_NUMBER = 1e50  # larger than any number of a camera; products of a few such numbers are still finite


def intrinsics(matrix: Array) -> Array:
    """3 x 3 K with pixel centres at +0.5, from one with centres at 0 (of 4 x 4, as in ScanNet, the upper left)."""
    return HALF_PIXEL @ np.asarray(matrix, np.float64)[:3, :3]


def homography(matrix: Array) -> Array:
    """3 x 3 H for pixel centres at +0.5, from an H for pixel centres at 0.

    Its sign says which side of its horizon is seen (`geometry.project`). It is changed only where the corner (0, 0)
    would be unseen and the rest mirrored: then the file has it in another scale.
    """
    moved = HALF_PIXEL @ np.asarray(matrix, np.float64) @ np.linalg.inv(HALF_PIXEL)
    return np.asarray(-moved if moved[2, 2] < 0 and np.linalg.det(moved) < 0 else moved)


def resized(matrix: Array, size: tuple[int, int], new_size: tuple[int, int]) -> Array:
    """K (pixel centres at +0.5) after an image of `size` (width, height) px was resized to `new_size`."""
    return np.diag([new_size[0] / size[0], new_size[1] / size[1], 1.0]) @ matrix


def between(left: Array, right: Array) -> Array:
    """4 x 4 pose, left camera to right camera, of two cameras (4 x 4 each, world to camera)."""
    return right @ inverse(left)


def inverse(pose: Array) -> Array:
    """The inverse of a 4 x 4 pose."""
    return np.asarray(np.linalg.inv(pose), np.float64)


def decompose(projection: Array) -> tuple[Array, Array]:
    """K (3 x 3, K[2, 2] = 1, positive diagonal) and the 4 x 4 world-to-camera matrix of P = K [R | t].

    projection: 3 x 4 or 4 x 4 (last row unused), at any scale and sign. Pixel centres stay where P has them. Hartley
    and Zisserman, Multiple View Geometry, 6.2.4.
    """
    p = np.asarray(projection, np.float64)[:3, :4]
    p = p * np.sign(np.linalg.det(p[:, :3]))
    upper, rotation = scipy.linalg.rq(p[:, :3])
    signs = np.diag(np.sign(np.diag(upper)))
    upper, rotation = upper @ signs, signs @ rotation
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = rotation, np.linalg.solve(upper, p[:, 3])
    return upper / upper[2, 2], camera


def matrix(values: ArrayLike, shape: tuple[int, int], what: str) -> Array:
    """`values` (nested or flat) as a float64 array of `shape`; `what` names it in the `InputError`."""
    try:
        array = np.array(values, np.float64).reshape(shape)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is no {shape[0]} x {shape[1]} matrix of numbers: correct the file") from error
    if not (np.abs(array) < MAX_NUMBER).all():
        raise InputError(f"{what} has a value that is not finite, or too large: correct the file")
    return array


def rigid(values: ArrayLike, what: str) -> Array:
    """`values` as a 4 x 4 rotation and translation, rotation exact to 1e-3; `what` names it in the `InputError`."""
    pose = matrix(values, (4, 4), what)
    rotation = pose[:3, :3]
    with np.errstate(all="ignore"):
        turned = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
    if not turned or not np.allclose(pose[3], (0, 0, 0, 1)):
        raise InputError(f"{what} is not a rotation with a translation (last row 0 0 0 1): correct the file")
    return pose


def calibration(values: ArrayLike, what: str) -> Array:
    """`values` as a 3 x 3 K (last row 0 0 1, focal lengths positive); `what` names it in the `InputError`."""
    k = matrix(values, (3, 3), what)
    if not np.allclose(k[2], (0, 0, 1)) or not (k[[0, 1], [0, 1]] > 1 / MAX_NUMBER).all():
        raise InputError(f"{what} is not a calibration matrix (focal lengths above 0, last row 0 0 1): correct it")
    return k


def numbers(words: Sequence[str], path: Path) -> Array:
    """(n,) float64 of the words of a text file; `InputError` names the file."""
    try:
        return np.array(words, np.float64)
    except ValueError as error:
        raise InputError(f"{path} holds words where numbers belong: copy or download it again") from error


def text_matrix(path: Path) -> Array:
    """The 4 x 4 numbers of a text file; some may be infinite or NaN."""
    values = numbers(text(path).split(), path)
    if values.size != 16:
        raise InputError(f"{path} holds {values.size} numbers, not 4 x 4: copy or download it again")
    return values.reshape(4, 4)


def archive(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of an .npz file by name."""
    try:
        return read_arrays(existing(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is damaged or not an .npz file: copy or download it again") from error


def mvsnet(path: Path) -> tuple[Array, Array]:
    """K and world-to-camera of a _cam.txt of MVSNet: "extrinsic", 4 x 4, "intrinsic", 3 x 3, depth range. Pixel centres
    stay where the file has them (at 0)."""
    words = text(path).split()
    if len(words) < 27 or words[0] != "extrinsic" or words[17] != "intrinsic":
        raise InputError(f"{path} is not an MVSNet camera file: copy or download it again")
    pose = rigid(numbers(words[1:17], path), f"extrinsic of {path}")
    return calibration(numbers(words[18:27], path), f"intrinsic of {path}"), pose


def idr(worlds: Mapping[str, NDArray[np.generic]], index: int, file: Path) -> tuple[Array, Array]:
    """K and world-to-camera of world_mat_<index> of a cameras.npz of IDR or NeuS. Pixel centres stay at 0."""
    if f"world_mat_{index}" not in worlds:
        raise InputError(f"{file} has no world_mat_{index}: complete the download")
    world = matrix(worlds[f"world_mat_{index}"], (4, 4), f"world_mat_{index} of {file}")
    try:
        with np.errstate(all="raise"):
            return decompose(world)
    except (np.linalg.LinAlgError, FloatingPointError) as error:  # not of rank 3, or with numbers that overflow
        raise InputError(f"world_mat_{index} of {file} is not a camera matrix: download it again") from error


def strecha(path: Path) -> tuple[Array, Array]:
    """K and world-to-camera of a .camera file (Strecha et al., CVPR 2008): K, three zeros, R from camera to world, the
    camera's centre, the size. Pixel centres stay at 0."""
    values = numbers(text(path).split(), path)
    if values.size != 26:
        raise InputError(f"{path} is not a .camera file of Strecha's data sets: copy or download it again")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = values[12:21].reshape(3, 3), values[21:24]
    pose = inverse(rigid(pose, f"pose of {path}"))
    return calibration(values[:9], f"K of {path}"), pose
