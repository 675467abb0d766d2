"""The rig that a calibration file of Middlebury or KITTI describes."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.listing import text
from zpm2.formats.cameras import calibration, intrinsics, matrix, numbers
from zpm2.model import Camera
from zpm2.stereo.rig import Rig, rig_of

Array = NDArray[np.float64]
Disparity = NDArray[np.float32]


def read_calibration(path: Path, size: tuple[int, int]) -> Rig:
    """The rig of a calibration file, for images of `size` (width, height) px.

    Middlebury (2014, 2021), calib.txt: cam0, cam1, baseline in mm. KITTI, calib.txt or calib_cam_to_cam.txt: the colour
    cameras P2 and P3 (or P_rect_02 and P_rect_03), in m. Both count pixel centres from 0.
    """
    lines = [re.match(r"\s*(\w+)\s*[=:]\s*(.*)", line) for line in text(path).splitlines()]
    values = {line[1]: line[2] for line in lines if line}
    for names in (("P2", "P3"), ("P_rect_02", "P_rect_03")):
        if all(name in values for name in names):
            return _kitti(values[names[0]], values[names[1]], path, _kitti_size(values, path) or size)
    try:
        own = int(values["width"]), int(values["height"])
        matrices = [
            calibration([row.split() for row in values[name].strip(" []").split(";")], f"{name} of {path}")
            for name in ("cam0", "cam1")
        ]
        left, right = (Camera(intrinsics(k), own) for k in matrices)
        return rig_of(left, right, float(values["baseline"]))
    except (LookupError, ArithmeticError, ValueError) as error:
        raise InputError(f"{path} is no calibration of Middlebury (cam0, cam1, baseline) or KITTI (P2, P3)") from error


def _kitti_size(values: dict[str, str], path: Path) -> tuple[int, int] | None:
    """px, from calib_cam_to_cam.txt; calib.txt has none."""
    if "S_rect_02" not in values:
        return None
    try:
        width, height = (round(float(word)) for word in values["S_rect_02"].split())
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{path} has an S_rect_02 that is not a width and a height: download it again") from error
    return width, height


def _kitti(left: str, right: str, path: Path, own: tuple[int, int]) -> Rig:
    """Both projections are K [I | t] in the frame of camera 0, for images of `own` px."""
    p, q = (matrix(numbers(words.split(), path), (3, 4), f"a projection of {path}") for words in (left, right))
    cameras = [Camera(intrinsics(calibration(k[:, :3], f"a projection of {path}")), own) for k in (p, q)]
    shift = np.linalg.solve(p[:, :3], p[:, 3]) - np.linalg.solve(q[:, :3], q[:, 3])
    return rig_of(cameras[0], cameras[1], float(shift[0]))
