"""A folder with photographs, their cameras and a mesh, as reconstruction programs and data sets write it.

COLMAP        images/, sparse/0/ or sparse/ (text or binary), *.ply; also inside dense/ (undistorted)
IDR, NeuS     image/, cameras.npz or cameras_sphere.npz (DTU: in millimetres, as scale_mat is not applied)
MVSNet        images/00000000.jpg, cams/00000000_cam.txt
Strecha       images/0000.jpg, 0000.jpg.camera beside them or in a folder of their own
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.surface import FORMATS
from zpm2.errors import InputError
from zpm2.files.listing import natural
from zpm2.formats import cameras as files
from zpm2.formats import colmap
from zpm2.model import Camera, PosedCamera
from zpm2.photos.listing import image_size, some_photographs
from zpm2.stereo.camera_check import checked, doubts

Array = NDArray[np.float64]
NPZ = ("cameras.npz", "cameras_sphere.npz")
IMAGES = ("images", "image", "dense/images")
MODELS = ("sparse/0", "sparse", "dense/sparse", "")
MESHES = ("mesh.ply", "meshed-poisson.ply", "meshed-delaunay.ply")


@dataclass(frozen=True, eq=False)
class PosedPhotograph:
    """A photograph with its camera."""

    name: str  # unique in its workspace
    path: Path
    camera: PosedCamera


def read_views(
    folder: Path, images: Path | None = None, cameras: Path | None = None, notes: list[str] | None = None
) -> list[PosedPhotograph]:
    """The photographs of a workspace with their cameras, in natural order.

    images, cameras: where they are, if not in the places above (cameras: a COLMAP model, an .npz file, or a folder of
    _cam.txt or .camera files). notes: receives a sentence on photographs that are left out because their camera model
    is not supported (an error without `notes`), and on doubtful cameras. `InputError` if no cameras are found (the
    message says where they were looked for), and if a camera does not fit its photograph.
    """
    if not os.path.isdir(folder):
        raise InputError(f"workspace {folder} is not a folder: give one with photographs, cameras and a mesh")
    views = _read(folder, images, cameras, notes)
    if len(views) < 2:
        raise InputError(f"workspace {folder} has {len(views)} photographs with a camera: a polygon cloud needs two")
    for view in views:
        have, want = image_size(view.path), view.camera.camera.size
        if have != want:
            raise InputError(
                f"{view.path} has {have[0]} x {have[1]} px, its camera {want[0]} x {want[1]} px: give the photographs "
                "that the cameras belong to (--images)"
            )
        checked(view.camera.camera, f"the camera of {view.name}", str(view.path))
    if notes is not None:
        notes += _doubts(views)
    return views


def _doubts(views: list[PosedPhotograph]) -> list[str]:
    """The doubts about the first doubtful camera, and the number of other doubtful cameras."""
    doubtful = [found for view in views if (found := doubts(view.camera.camera, f"the camera of {view.name}"))]
    more = f" (and {len(doubtful) - 1} more cameras)" if len(doubtful) > 1 else ""
    return [text + more for text in doubtful[0]] if doubtful else []


def find_mesh(folder: Path) -> Path:
    """The mesh of a workspace: a known name, or else the only mesh file. `InputError` if there are none or several."""
    places = [folder, folder / "dense", folder / "dense" / "0"]
    for place in places:
        for name in MESHES:
            if (place / name).is_file():
                return place / name
    found = [p for place in places if place.is_dir() for p in sorted(place.iterdir()) if p.suffix.lower() in FORMATS]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{folder} has several meshes: {', '.join(p.name for p in found)}: choose one with --mesh")
    raise InputError(f"no mesh in {folder}, neither {', '.join(MESHES)} nor another: give one with --mesh")


def _read(folder: Path, images: Path | None, cameras: Path | None, notes: list[str] | None) -> list[PosedPhotograph]:
    pictures = images or next((folder / name for name in IMAGES if (folder / name).is_dir()), folder)
    if not os.path.isdir(pictures):
        raise InputError(f"{pictures} is not a folder: give the one with the photographs (--images)")
    if cameras is None:
        cameras = _find_cameras(folder, pictures)
    if cameras.suffix.lower() == ".npz":
        return _idr(cameras, some_photographs(pictures))
    if not os.path.isdir(cameras):
        raise InputError(f"cameras {cameras} is neither a folder nor an .npz file: check the path")
    if any(cameras.glob("*_cam.txt")):
        return _each(some_photographs(pictures), lambda p: cameras / f"{p.stem}_cam.txt", files.mvsnet)
    if any(cameras.glob("*.camera")):
        return _each(some_photographs(pictures), lambda p: cameras / f"{p.name}.camera", files.strecha)
    posed = colmap.read_poses(cameras, notes)
    views = [PosedPhotograph(name, pictures / name, camera) for name, camera in posed.items()]
    missing = [view.path for view in views if not os.path.isfile(view.path)]  # whatever its suffix
    if missing:
        raise InputError(
            f"{missing[0]}, which the model {cameras} names, does not exist: give its folder with --images"
        )
    return sorted(views, key=lambda view: natural(Path(view.name)))


def _find_cameras(folder: Path, pictures: Path) -> Path:
    for name in NPZ:
        if (folder / name).is_file():
            return folder / name
    for place in (folder / "cams", folder / "cameras", pictures, *(p for p in sorted(folder.iterdir()) if p.is_dir())):
        if place.is_dir() and (any(place.glob("*_cam.txt")) or any(place.glob("*.camera"))):
            return place
    for name in MODELS:
        if any((folder / name / f"images.{kind}").is_file() for kind in ("txt", "bin")):
            return folder / name
    raise InputError(
        f"no cameras in {folder}, neither sparse/0, sparse, {', '.join(NPZ)}, cams/*_cam.txt nor *.camera: "
        "give them with --cameras"
    )


def _idr(file: Path, pictures: list[Path]) -> list[PosedPhotograph]:
    worlds = files.archive(file)
    count = sum(name.startswith("world_mat_") and name[10:].isdecimal() for name in worlds)
    if len(pictures) != count:
        raise InputError(f"{file} has {count} cameras for {len(pictures)} photographs: give one camera for each")
    return [_view(picture, *files.idr(worlds, k, file)) for k, picture in enumerate(pictures)]


def _each(
    pictures: list[Path], file_of: Callable[[Path], Path], read: Callable[[Path], tuple[Array, Array]]
) -> list[PosedPhotograph]:
    return [_view(picture, *read(file_of(picture))) for picture in pictures if file_of(picture).is_file()]


def _view(picture: Path, matrix: Array, pose: Array) -> PosedPhotograph:
    """A photograph and its camera, from a file where the first pixel's centre has the coordinate 0."""
    camera = Camera(files.intrinsics(matrix), image_size(picture))
    return PosedPhotograph(picture.name, picture, PosedCamera(camera, pose[:3, :3], pose[:3, 3]))
