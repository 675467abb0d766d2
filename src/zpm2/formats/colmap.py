"""COLMAP's files: cameras and poses in; a database and a two-view model out (package pycolmap, the extra `colmap`)."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from zpm2.errors import InputError, MissingDependency, Zpm2Error
from zpm2.files.listing import text
from zpm2.files.record import refuse_foreign
from zpm2.formats import colmap_binary as _binary
from zpm2.model import Camera, PosedCamera

if TYPE_CHECKING:
    import pycolmap

Array = NDArray[np.float64]

# COLMAP's parameters -> fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 (https://colmap.github.io/cameras.html)
_MODELS: dict[str, Callable[..., tuple[float, ...]]] = {
    "SIMPLE_PINHOLE": lambda f, x, y: (f, f, x, y),
    "PINHOLE": lambda fx, fy, x, y: (fx, fy, x, y),
    "SIMPLE_RADIAL": lambda f, x, y, k: (f, f, x, y, k, 0, 0, 0),
    "RADIAL": lambda f, x, y, k1, k2: (f, f, x, y, k1, k2, 0, 0),
    "OPENCV": lambda *p: p,
    "FULL_OPENCV": lambda *p: p,
}


def require_pycolmap() -> ModuleType:
    """The package, or `MissingDependency`."""
    try:
        import pycolmap
    except ImportError as error:
        raise MissingDependency('COLMAP files need pycolmap: pip install "zpm2[colmap]"') from error
    return pycolmap


@contextmanager
def colmap_can(what: str) -> Iterator[None]:
    """Turns any error that pycolmap raises inside into an `InputError` of one line: "COLMAP cannot `what`: ...".

    pycolmap opens files itself, after our checks, and raises many kinds of errors: `ValueError`, `IndexError`,
    `RuntimeError`, `MemoryError`.
    """
    try:
        yield
    except (Zpm2Error, OSError):
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"COLMAP cannot {what}: {said}") from error


def seeded(verification: "pycolmap.TwoViewGeometryOptions", seed: int) -> "pycolmap.TwoViewGeometryOptions":
    """Options of geometric verification, which now draw the same samples each time."""
    verification.ransac.random_seed = seed
    return verification


def open_model(folder: Path) -> "pycolmap.Reconstruction":
    """The pycolmap.Reconstruction of a model that a run of ours wrote into its claimed folder.

    pycolmap trusts the counts in a model's files, so a damaged file of seventy bytes can take gigabytes of memory. We
    therefore open only files that are unchanged since zpm2 wrote them (`record.refuse_foreign`): `OutputError` for
    others, `InputError` where COLMAP refuses a file.
    """
    for file in sorted(folder.glob("*.bin")):
        refuse_foreign(file)
    with colmap_can(f"read the model {folder}: remove the folder and run again"):
        return require_pycolmap().Reconstruction(str(folder))


def camera(model: str, size: tuple[int, int], parameters: Iterable[float], what: str) -> Camera:
    """A camera of a COLMAP model. `InputError` (`what` names the camera) for models not in `_MODELS`, as fisheyes."""
    if model not in _MODELS:
        raise InputError(
            f"{what} has camera model {model}; known are {', '.join(_MODELS)}: undistort the images with COLMAP first"
        )
    try:
        values = np.array(_MODELS[model](*(float(p) for p in parameters)))
        matrix = np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1.0]])
    except (TypeError, ValueError, IndexError) as error:
        raise InputError(f"{what} has wrong parameters for {model}: export the model again") from error
    return Camera(matrix, size, values[4:])


def to_pycolmap(camera: Camera, key: int) -> "pycolmap.Camera":
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


@dataclass(frozen=True, eq=False)
class Model:
    """The content of a model's files. Cameras are interpreted on request, so that an unknown camera model does not stop
    the use of the others."""

    folder: Path
    cameras: dict[int, tuple[str, tuple[int, int], tuple[float, ...]]]  # id -> model, size, parameters
    images: dict[str, tuple[int, Array, Array]]  # name with its sub-folder -> id of its camera, R (3, 3), t (3,)

    def camera(self, key: int) -> Camera:
        """`InputError` for a camera that the model lacks, and for a camera model that we do not support."""
        if key not in self.cameras:
            raise InputError(f"{self.folder} has images of camera {key} but lacks this camera: export it again")
        return camera(*self.cameras[key], f"camera {key} of {self.folder}")


class Cameras(Mapping[str, Camera]):
    """The cameras of a model by image name (with sub-folders), or by camera id where the model has no images."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self.keys_of = {name: key for name, (key, _, _) in model.images.items()} or {str(k): k for k in model.cameras}

    def __getitem__(self, name: str) -> Camera:
        return self._model.camera(self.keys_of[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys_of)

    def __len__(self) -> int:
        return len(self.keys_of)


def read_cameras(path: Path) -> Cameras:
    """The cameras of a model (its folder, cameras.txt or cameras.bin)."""
    return Cameras(read_model(path if os.path.isdir(path) else path.parent, binary=path.name == "cameras.bin"))


def camera_of(cameras: Cameras, image: str | Path, what: str) -> Camera:
    """The camera of an image file, found by the image's name in the model.

    The longest name (with sub-folders) that the file's path ends with counts; else the only image with this file name;
    else the only camera. `InputError` (`what` names the model) where several cameras remain.
    """
    parts = Path(os.path.abspath(image)).parts
    named = [name for name in cameras if PurePosixPath(name).name == parts[-1]]
    ends = [name for name in named if parts[-len(PurePosixPath(name).parts) :] == PurePosixPath(name).parts]
    chosen = [max(ends, key=lambda name: len(PurePosixPath(name).parts))] if ends else named or list(cameras)
    keys = {cameras.keys_of[name] for name in chosen}
    if len(keys) == 1:
        return cameras[chosen[0]]
    if named:
        raise InputError(f"{what} has images {', '.join(named)}, and {image} is none of them: give it from its folder")
    raise InputError(
        f"{what} has no image '{parts[-1]}' and more than one camera: give numbers or a matrix, or the image by the "
        "name that it has there"
    )


def read_poses(folder: Path, notes: list[str] | None = None) -> dict[str, PosedCamera]:
    """The registered images of a model by name, as the model has it (with its sub-folder), in the order of their names.

    `InputError` where there is no model or no image, and for a camera model that we do not support. With `notes` the
    images of such cameras are left out instead, and a note is added.
    """
    model = read_model(folder)
    if not model.images:
        raise InputError(f"the COLMAP model {folder} has no registered image: reconstruct it again")
    posed, foreign = {}, list[str]()
    for name, (key, turn, shift) in sorted(model.images.items()):
        if notes is not None and key in model.cameras and model.cameras[key][0] not in _MODELS:
            foreign.append(name)
        else:
            posed[name] = PosedCamera(model.camera(key), turn, shift)
    if notes is not None and foreign:
        models = ", ".join(sorted({model.cameras[model.images[name][0]][0] for name in foreign}))
        notes.append(
            f"{len(foreign)} of {len(model.images)} photographs have a camera of model {models} and are left out: "
            "undistort them with COLMAP to use them"
        )
    return posed


def read_model(folder: Path, binary: bool = False) -> Model:
    """The model in a folder: text, else binary files.

    We read both ourselves. pycolmap cuts names in text files at the first space, drops a last image that has no line of
    points, requires points3D, and trusts every count in a binary file. `InputError` where there is no model.
    """
    if os.path.isfile(folder / "cameras.txt") and not binary:
        return _from_text(folder)
    if os.path.isfile(folder / "cameras.bin"):
        return _from_binary(folder)
    raise InputError(f"{folder} has no cameras.txt or cameras.bin: give the folder of a COLMAP model")


def _from_binary(folder: Path) -> Model:
    listed = folder / "images.bin"
    try:
        cameras = {key: (kind, size, values) for key, kind, size, values in _binary.cameras(folder / "cameras.bin")}
        found = list(_binary.images(listed)) if listed.exists() else []
        images = {name: (key, *_pose(turn, shift)) for name, key, turn, shift in found}
    except (OSError, ValueError) as error:
        raise InputError(f"{folder} is not a complete COLMAP model: {error}; export it again") from error
    return Model(folder, cameras, images)


def _from_text(folder: Path) -> Model:
    cameras, images = {}, {}
    try:
        for key, kind, width, height, *parameters in _camera_lines(folder / "cameras.txt"):
            cameras[int(key)] = kind, (int(width), int(height)), tuple(float(word) for word in parameters)
        for words, _ in _image_lines(folder / "images.txt"):
            w, x, y, z, *shift = (float(word) for word in words[1:8])
            images[words[9].rstrip()] = int(words[8]), *_pose((w, x, y, z), shift)
    except (ValueError, LookupError) as error:
        raise InputError(f"{folder} is not a complete COLMAP model in text form: {error}") from error
    return Model(folder, cameras, images)


def shared_points(folder: Path) -> tuple[list[str], NDArray[np.int64]]:
    """The names of a model's images, sorted, and (n, n) how many of its 3D points each two of them show. `InputError`
    where there is no model."""
    model = read_model(folder)
    if not model.images:
        raise InputError(f"the COLMAP model {folder} has no registered image: reconstruct it again")
    try:
        if os.path.isfile(folder / "cameras.txt"):
            lines = _image_lines(folder / "images.txt")
            ids = {words[9].rstrip(): np.array(points[2::3], np.int64) for words, points in lines}
        else:
            ids = dict(_binary.image_points(folder / "images.bin"))
    except (OSError, ValueError, LookupError, OverflowError) as error:
        raise InputError(f"{folder} is not a complete COLMAP model: {error}; export it again") from error
    names = sorted(ids)
    seen = [np.unique(ids[name][ids[name] >= 0]) for name in names]  # -1: a point of the image alone
    found, columns = np.unique(np.concatenate(seen), return_inverse=True)
    rows = np.repeat(np.arange(len(names)), [len(each) for each in seen])
    shows = csr_array((np.ones(len(rows), np.int64), (rows, columns)), (len(names), len(found)))
    return names, (shows @ shows.T).toarray()


def _pose(turn: Sequence[float], shift: Sequence[float]) -> tuple[Array, Array]:
    """R and t from a quaternion (w, x, y, z) of any length and a translation."""
    w, x, y, z = turn
    if not np.isfinite([*turn, *shift]).all():
        raise ValueError("it has a pose that is not finite")
    return Rotation.from_quat([x, y, z, w]).as_matrix(), np.array(shift)


def _camera_lines(path: Path) -> list[list[str]]:
    return [line.split() for line in text(path).split("\n") if line.strip() and not line.lstrip().startswith("#")]


def _image_lines(path: Path) -> list[tuple[list[str], list[str]]]:
    """The words of each image: id, qw, qx, qy, qz, tx, ty, tz, camera, name (to the end of its line, with its spaces),
    and of its points: x, y, id and so on.

    The line after an image holds its points, and may be empty; any other line may be empty or a comment.
    """
    found: list[tuple[list[str], list[str]]] = []
    after_image = False
    for line in text(path).split("\n") if path.is_file() else ():
        if line.lstrip().startswith("#"):
            continue
        if after_image and _are_points(line):
            found[-1] = found[-1][0], line.split()
            after_image = False
        elif line.strip():
            found.append((line.split(maxsplit=9), []))
            after_image = True
    return found


def _are_points(line: str) -> bool:
    words = line.split()
    try:
        [float(word) for word in words[:12]]  # where a name would be among them
    except ValueError:
        return False
    return len(words) % 3 == 0
