"""COLMAP's files: cameras and poses in; a database and a two-view model out (package pycolmap, the extra `colmap`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from zpm2.errors import InputError, MissingDependency
from zpm2.model import Camera, PosedCamera

# COLMAP's parameters -> fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 (https://colmap.github.io/cameras.html)
_MODELS: dict[str, Callable[..., tuple[float, ...]]] = {
    "SIMPLE_PINHOLE": lambda f, x, y: (f, f, x, y),
    "PINHOLE": lambda fx, fy, x, y: (fx, fy, x, y),
    "SIMPLE_RADIAL": lambda f, x, y, k: (f, f, x, y, k, 0, 0, 0),
    "RADIAL": lambda f, x, y, k1, k2: (f, f, x, y, k1, k2, 0, 0),
    "OPENCV": lambda *p: p,
    "FULL_OPENCV": lambda *p: p,
}


def require_pycolmap() -> Any:
    """The package, or `MissingDependency`."""
    try:
        import pycolmap
    except ImportError as error:
        raise MissingDependency('COLMAP files need pycolmap: pip install "zpm2[colmap]"') from error
    return pycolmap


def camera(model: str, size: tuple[int, int], parameters: Any, what: str) -> Camera:
    """A camera of one of COLMAP's models; `InputError`, which calls it `what`, for fisheyes and other foreign ones."""
    if model not in _MODELS:
        raise InputError(
            f"{what} has camera model {model}; known are {', '.join(_MODELS)}: undistort the images with COLMAP first"
        )
    try:
        values = np.array(_MODELS[model](*(float(p) for p in parameters)))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} has wrong parameters for {model}: export the model again") from error
    matrix = np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1.0]])
    return Camera(matrix, size, values[4:])


def to_pycolmap(camera: Camera, key: int) -> Any:
    """A pycolmap.Camera with an id: PINHOLE, OPENCV or FULL_OPENCV."""
    pycolmap = require_pycolmap()
    fx, fy, cx, cy = camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    bent = camera.distortion
    name = "PINHOLE" if not bent.any() else "OPENCV" if len(bent) <= 4 else "FULL_OPENCV"
    count = {"PINHOLE": 0, "OPENCV": 4, "FULL_OPENCV": 8}[name]
    params = [fx, fy, cx, cy, *bent[:count], *[0.0] * (count - len(bent[:count]))]
    made = pycolmap.Camera(model=name, width=camera.size[0], height=camera.size[1], params=params)
    made.camera_id = key
    made.has_prior_focal_length = camera.source in ("given", "exif")
    return made


def read_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of a model (its folder, cameras.txt or cameras.bin) by image file name; by id where it has no images.

    Text needs nothing, binary files need pycolmap.
    """
    folder = path if path.is_dir() else path.parent
    if path.name != "cameras.bin" and (folder / "cameras.txt").is_file():
        return _from_text(folder)
    if not (folder / "cameras.bin").is_file():
        raise InputError(f"{folder} has no cameras.txt or cameras.bin: give the folder of a COLMAP model")
    model, cameras = _from_binary(folder)
    named = {Path(image.name).name: cameras[image.camera_id] for image in model.images.values()}
    return named or {str(key): c for key, c in cameras.items()}


def read_poses(folder: Path) -> dict[str, PosedCamera]:
    """The registered images of a model by name, as the model has it (with its sub-folder), in the order of their names.

    Text needs nothing, binary files need pycolmap. `InputError` for what is no model, and for one without images.
    """
    if (folder / "images.txt").is_file():
        posed = _poses_from_text(folder)
    elif (folder / "images.bin").is_file():
        model, cameras = _from_binary(folder)
        posed = {}
        for image in model.images.values():
            pose = image.cam_from_world()
            turn, shift = np.asarray(pose.rotation.matrix()), np.asarray(pose.translation)
            posed[image.name] = PosedCamera(cameras[image.camera_id], turn, shift)
    else:
        raise InputError(f"{folder} has no images.txt or images.bin: give the folder of a COLMAP model")
    if not posed:
        raise InputError(f"the COLMAP model {folder} has no registered image: reconstruct it again")
    return dict(sorted(posed.items()))


def _from_binary(folder: Path) -> tuple[Any, dict[int, Camera]]:
    pycolmap = require_pycolmap()
    try:
        model = pycolmap.Reconstruction(str(folder))
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"{folder} is no COLMAP model: {str(error).splitlines()[0]}") from error
    return model, {
        key: camera(c.model_name, (c.width, c.height), c.params, f"camera {key} of {folder}")
        for key, c in model.cameras.items()
    }


def _from_text(folder: Path) -> dict[str, Camera]:
    try:
        cameras = _cameras_from_text(folder)
        if not (folder / "images.txt").is_file():
            return cameras
        named = {Path(words[9].strip()).name: cameras[words[8]] for words in _image_lines(folder)}
    except (OSError, ValueError, LookupError) as error:
        raise InputError(f"{folder} is no complete COLMAP model in text form: {error}") from error
    return named or cameras


def _poses_from_text(folder: Path) -> dict[str, PosedCamera]:
    posed = {}
    try:
        cameras = _cameras_from_text(folder)
        for words in _image_lines(folder):
            w, x, y, z, *shift = (float(word) for word in words[1:8])
            turn = Rotation.from_quat([x, y, z, w]).as_matrix()
            posed[words[9].strip()] = PosedCamera(cameras[words[8]], turn, np.array(shift))
    except (OSError, ValueError, LookupError) as error:
        raise InputError(f"{folder} is no complete COLMAP model in text form: {error}") from error
    return posed


def _cameras_from_text(folder: Path) -> dict[str, Camera]:
    found: dict[str, Camera] = {}
    for key, model, width, height, *parameters in _lines(folder / "cameras.txt"):
        found[key] = camera(model, (int(width), int(height)), parameters, f"camera {key} of {folder}")
    return found


def _image_lines(folder: Path) -> list[list[str]]:
    """The words of each image: id, qw, qx, qy, qz, tx, ty, tz, camera, name."""
    # every second line holds the points of the image before it, and may be empty
    lines = (folder / "images.txt").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    return [line.split(maxsplit=9) for line in lines[::2] if line.strip()]


def _lines(path: Path) -> list[list[str]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.split() for line in lines if line.strip() and not line.startswith("#")]
