"""A pose as COLMAP's files: a database with the verified points, and a two-view model (package pycolmap)."""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.errors import Failed, InputError, OutputError
from zpm2.files.record import make_folder, move_into_place, temporary_folder
from zpm2.files.writing import claim, why
from zpm2.formats.colmap import colmap_can, require_pycolmap, to_pycolmap
from zpm2.pose.result import PoseResult

if TYPE_CHECKING:
    import pycolmap


def write(result: PoseResult, names: tuple[str, str], directory: str | Path) -> Path:
    """`database.db` and `sparse/0` (cameras, images, points in binary form) in a folder, which is returned.

    names: those of the image files. The left camera is the origin; the length of the baseline is that of the result,
    or 1. Every point of the result is a keypoint, inliers are two-view matches, and points of the model where the two
    rays meet before both cameras. Files of an earlier run are replaced; `OutputError` where something else has one of
    the names.
    """
    pycolmap = require_pycolmap()
    if isinstance(result.pose, Failed) or isinstance(result.cameras, Failed) or result.translation is None:
        raise InputError("a model for COLMAP needs a pose with a translation, and this result has none")
    if names[0] == names[1]:
        raise InputError(f"both images are called {names[0]}: COLMAP needs names that differ")
    folder = claim(directory, ["database.db", "sparse"])
    cameras = [to_pycolmap(camera, k + 1) for k, camera in enumerate(result.cameras)]
    motion = np.c_[result.pose.rotation, result.translation]
    try:
        with temporary_folder(folder) as part, colmap_can(f"write into {folder}"):
            _write_database(pycolmap, result, names, cameras, motion, part / "database.db")
            model = _model(pycolmap, result, names, cameras, motion)
            (part / "model").mkdir()
            model.write_binary(str(part / "model"))
            move_into_place(part / "database.db", folder / "database.db")
            target = make_folder(make_folder(folder / "sparse") / "0")
            for file in sorted((part / "model").iterdir()):
                move_into_place(file, target / file.name)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {why(error, folder)}") from error
    return folder


def _write_database(
    pycolmap: ModuleType,
    result: PoseResult,
    names: tuple[str, str],
    cameras: "Sequence[pycolmap.Camera]",
    motion: NDArray[np.float64],
    path: Path,
) -> None:
    database = pycolmap.Database.open(str(path))
    try:
        sides = result.points.points.left, result.points.points.right
        for key, (name, camera, points) in enumerate(zip(names, cameras, sides, strict=True), 1):
            database.write_camera(camera, use_camera_id=True)
            database.write_image(pycolmap.Image(name=name, camera_id=key, image_id=key), use_image_id=True)
            database.write_keypoints(key, points.astype(np.float32))
        rows = np.arange(len(result.points), dtype=np.uint32)
        database.write_matches(1, 2, np.c_[rows, rows])
        kind = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
        verified = pycolmap.TwoViewGeometry(
            config=kind, cam2_from_cam1=pycolmap.Rigid3d(motion), inlier_matches=np.c_[rows, rows][result.inliers]
        )
        assert not isinstance(result.pose, Failed)
        verified.E = result.pose.essential
        database.write_two_view_geometry(1, 2, verified)
    finally:
        database.close()


def _model(
    pycolmap: ModuleType,
    result: PoseResult,
    names: tuple[str, str],
    cameras: "Sequence[pycolmap.Camera]",
    motion: NDArray[np.float64],
) -> "pycolmap.Reconstruction":
    assert not isinstance(result.cameras, Failed)
    model = pycolmap.Reconstruction()
    sides = result.points.points.left, result.points.points.right
    poses = pycolmap.Rigid3d(np.eye(3, 4)), pycolmap.Rigid3d(motion)
    for key, (name, camera, points, pose) in enumerate(zip(names, cameras, sides, poses, strict=True), 1):
        model.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=name, points2D=pycolmap.Point2DList([pycolmap.Point2D(p) for p in points]))
        image.image_id, image.camera_id = key, key
        model.add_image_with_trivial_frame(image, pose)
    rows = np.flatnonzero(result.inliers)
    rays = [camera.rays(points[rows]).T for camera, points in zip(result.cameras, sides, strict=True)]
    space = cv2.triangulatePoints(np.eye(3, 4), motion, *rays)
    for row, point in zip(rows, (space[:3] / space[3]).T, strict=True):
        if np.isfinite(point).all():
            track = pycolmap.Track([pycolmap.TrackElement(1, int(row)), pycolmap.TrackElement(2, int(row))])
            model.add_point3D(point, track)
    model.update_point_3d_errors()
    return model
