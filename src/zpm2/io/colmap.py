"""COLMAP's files: cameras in; a database and a two-view model out (package pycolmap, the extra `colmap`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zpm2.errors import InputError, MissingDependency
from zpm2.model import Camera

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


def read_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of a model (its folder, cameras.txt or cameras.bin) by image file name; by id where it has no images.

    Text needs nothing, binary files need pycolmap.
    """
    folder = path if path.is_dir() else path.parent
    if path.name != "cameras.bin" and (folder / "cameras.txt").is_file():
        return _from_text(folder)
    if not (folder / "cameras.bin").is_file():
        raise InputError(f"{folder} has no cameras.txt or cameras.bin: give the folder of a COLMAP model")
    pycolmap = require_pycolmap()
    try:
        model = pycolmap.Reconstruction(str(folder))
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"{folder} is no COLMAP model: {str(error).splitlines()[0]}") from error
    cameras = {
        key: camera(c.model_name, (c.width, c.height), c.params, f"camera {key} of {folder}")
        for key, c in model.cameras.items()
    }
    named = {Path(image.name).name: cameras[image.camera_id] for image in model.images.values()}
    return named or {str(key): c for key, c in cameras.items()}


def _from_text(folder: Path) -> dict[str, Camera]:
    try:
        cameras: dict[str, Camera] = {}
        for key, model, width, height, *parameters in _lines(folder / "cameras.txt"):
            cameras[key] = camera(model, (int(width), int(height)), parameters, f"camera {key} of {folder}")
        if not (folder / "images.txt").is_file():
            return cameras
        # every second line holds the points of the image before it, and may be empty
        lines = (folder / "images.txt").read_text(encoding="utf-8").splitlines()
        lines = [line for line in lines if not line.startswith("#")]
        images = [line.split(maxsplit=9) for line in lines[::2] if line.strip()]
        named = {Path(words[9].strip()).name: cameras[words[8]] for words in images}
    except (OSError, ValueError, LookupError) as error:
        raise InputError(f"{folder} is no complete COLMAP model in text form: {error}") from error
    return named or cameras


def _lines(path: Path) -> list[list[str]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.split() for line in lines if line.strip() and not line.startswith("#")]
