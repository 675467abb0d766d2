"""A camera from what people have: numbers, a matrix file, a COLMAP model, EXIF, or an assumption that is called one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.errors import Failed, InputError
from zpm2.io.colmap import read_cameras
from zpm2.model import Camera
from zpm2.model.camera import Source

Array = NDArray[np.float64]
Size = tuple[int, int]  # width, height, px

GUESS = 1.2  # focal length over the longer side, where it is guessed: COLMAP's default, a field of view of 45 degrees
FULL_FRAME = 43.266615  # mm, diagonal of 36 x 24 mm, to which "35 mm equivalent" refers (CIPA DCG-001)
OFF_CENTRE, ON_CENTRE = 0.15, 0.08  # of a side, a principal point that speaks against and for an image
EXIF_IFD, MODEL, UNITS = 0x8769, 0x0110, {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # mm per unit of resolution
FOCAL, FOCAL_35, PLANE_X, PLANE_UNIT, WIDTH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002


def read_camera(text: str, image: str | Path, size: Size, centers: float = 0.5, name: str = "K") -> Camera:
    """The camera that `text` describes, for an image of `size` px.

    text: "fx,fy,cx,cy" and up to eight coefficients of distortion (k1,k2,p1,p2[,k3[,k4,k5,k6]]); a file with a matrix
        (3 x 3 as text or .npy; JSON with "matrix" and maybe "distortion"); a COLMAP model (its folder, cameras.txt or
        cameras.bin); "exif"; or "guess", a focal length of 1.2 times the longer side.
    centers: where the numbers or the matrix have the centre of the first pixel, 0.5 or 0 (OpenCV). COLMAP has 0.5.

    `InputError` says what is wrong, and calls the camera `name`.
    """
    words = [word.strip() for word in text.split(",")]
    if text in ("exif", "guess"):
        found = from_exif(image, size) if text == "exif" else guess(size)
        if isinstance(found, Failed):
            raise InputError(f"--{name} exif: {found.reason}; give --{name} as numbers, a file, or guess")
        return found
    path = Path(text)
    if path.is_dir() or path.name in ("cameras.txt", "cameras.bin"):
        return checked(_from_colmap(path, image, size, name), name)
    values = _numbers(words)
    if values is not None and len(values) >= 4:
        fx, fy, cx, cy = values[:4]
        matrix, distortion = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), values[4:]
    elif path.is_file():
        matrix, distortion = _from_file(path, name)
    else:
        raise InputError(
            f"--{name} '{text}' is no file and not fx,fy,cx,cy; give numbers in px, a matrix file, a COLMAP model, "
            "exif or guess"
        )
    if np.shape(matrix) == (3, 3):
        matrix = matrix + np.array([[0, 0, 0.5 - centers], [0, 0, 0.5 - centers], [0, 0, 0]])
    return checked(Camera(np.asarray(matrix), size, np.asarray(distortion)), name)


def checked(camera: Camera, name: str = "K") -> Camera:
    """The same camera; `InputError` if it cannot be one of an image of its size."""
    k, (width, height) = camera.matrix, camera.size
    if k.shape != (3, 3):
        raise InputError(f"{name} has shape {' x '.join(map(str, k.shape))}: expected a 3 x 3 matrix")
    if not np.isfinite(k).all() or not np.isfinite(camera.distortion).all():
        raise InputError(f"{name} has values that are not finite: {_flat(k)}; correct it")
    if not (k[0, 0] > 0 and k[1, 1] > 0):
        raise InputError(f"{name} has focal lengths {k[0, 0]:g} and {k[1, 1]:g} px: they must be positive")
    if k[1, 0] or k[2].tolist() != [0, 0, 1]:
        raise InputError(f"{name} must be [fx s cx; 0 fy cy; 0 0 1] in px, got {_flat(k)}")
    if len(camera.distortion) not in (0, 2, 4, 5, 8):
        raise InputError(f"{name} has {len(camera.distortion)} coefficients of distortion: 2, 4, 5 or 8 are known")
    if not (0 < k[0, 2] < width and 0 < k[1, 2] < height):
        raise InputError(
            f"{name} has its principal point at ({k[0, 2]:g}, {k[1, 2]:g}), outside of the image of {width} x {height} "
            "px: was it made for another size, or are the two cameras swapped?"
        )
    if not width / 50 < k[0, 0] < 200 * width:
        raise InputError(f"{name} has a focal length of {k[0, 0]:g} px for a width of {width} px: it must be in px")
    return camera


def refuse_swapped(cameras: tuple[Camera, Camera]) -> None:
    """`InputError` if each camera's principal point speaks against its own image and for the other one's."""
    (a, b), sizes = cameras, (cameras[0].size, cameras[1].size)
    if sizes[0] == sizes[1]:
        return
    mine = [_off_centre(c, s) for c, s in zip((a, b), sizes, strict=True)]
    other = [_off_centre(c, s) for c, s in zip((b, a), sizes, strict=True)]
    if max(mine) > OFF_CENTRE and max(other) < ON_CENTRE:
        raise InputError("K and K2 seem to be swapped: each principal point is the centre of the other image")


def guess(size: Size) -> Camera:
    """A camera about which nothing is known: 1.2 times the longer side, principal point in the middle."""
    return centred(GUESS * max(size), size, "guess")


def from_exif(image: str | Path, size: Size) -> Camera | Failed:
    """The focal length that the photograph's EXIF holds, with the principal point in the middle.

    From the 35 mm equivalent, which by CIPA's rule keeps the diagonal; else from the focal length and the resolution of
    the sensor; else, where pycolmap is installed, from its table of sensors by the camera's name.
    """
    try:
        with PIL.Image.open(image) as picture:
            exif = picture.getexif()
            values = exif.get_ifd(EXIF_IFD)
    except (OSError, SyntaxError, ValueError, TypeError, LookupError) as error:
        return Failed(f"the EXIF data of {image} cannot be read ({error})")
    diagonal = float(np.hypot(*size))
    if (equivalent := _positive(values.get(FOCAL_35))) is not None:
        return centred(equivalent / FULL_FRAME * diagonal, size, "exif")
    focal, resolution = _positive(values.get(FOCAL)), _positive(values.get(PLANE_X))
    if focal is not None and resolution is not None and values.get(PLANE_UNIT) in UNITS:
        stored = _positive(values.get(WIDTH)) or size[0]
        return centred(focal * resolution / UNITS[values[PLANE_UNIT]] * size[0] / stored, size, "exif")
    if focal is not None and (found := _from_sensor_table(image, size)) is not None:
        return found
    known = f"focal length {focal:g} mm without the size of the sensor" if focal else "no focal length"
    return Failed(f"the EXIF data of {image} has {known}")


def _from_sensor_table(image: str | Path, size: Size) -> Camera | None:
    try:
        import pycolmap
    except ImportError:
        return None
    camera = pycolmap.infer_camera_from_image(str(image))
    return centred(camera.mean_focal_length(), size, "exif") if camera.has_prior_focal_length else None


def _from_colmap(path: Path, image: str | Path, size: Size, name: str) -> Camera:
    cameras = read_cameras(path)
    file = Path(image).name
    if file in cameras:
        camera = cameras[file]
    elif len({id(c) for c in cameras.values()}) == 1:
        camera = next(iter(cameras.values()))
    else:
        raise InputError(f"{path} has no image '{file}' and more than one camera: give --{name} as numbers or a matrix")
    if camera.size != size:
        raise InputError(
            f"{name} of {path} is for an image of {camera.size[0]} x {camera.size[1]} px, {file} has {size[0]} x "
            f"{size[1]} px: give the camera of this size"
        )
    return camera


def _from_file(path: Path, name: str) -> tuple[Array, Array]:
    """The matrix of a file, of whatever shape, and the coefficients of distortion beside it."""
    try:
        if path.suffix.lower() == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), np.float64), np.zeros(0)
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".json":
            values = json.loads(text)
            return np.array(values["matrix"], np.float64), np.array(values.get("distortion", ()), np.float64).ravel()
        rows = [[float(word) for word in line.replace(",", " ").split()] for line in text.splitlines() if line.strip()]
        flat = np.array([value for row in rows for value in row])
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"--{name} {path} holds no camera matrix ({error!r}): give 3 x 3 numbers in px") from error
    if len(flat) == 9:
        return flat.reshape(3, 3), np.zeros(0)
    if len(flat) in (12, 16) and len(rows) in (3, 4):
        return flat.reshape(len(rows), -1)[:3, :3], np.zeros(0)
    raise InputError(f"--{name} {path} holds {len(flat)} numbers: expected a 3 x 3 matrix")


def centred(focal: float, size: Size, source: Source) -> Camera:
    """A camera with square pixels and its principal point in the middle of the image."""
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    return Camera(matrix, size, source=source)


def _off_centre(camera: Camera, size: Size) -> float:
    """How far the principal point is from the middle of an image of `size`, as a share of its side."""
    return float(np.abs(camera.matrix[:2, 2] / np.array(size) - 0.5).max())


def _numbers(words: Sequence[str]) -> Array | None:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return None


def _positive(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < float("inf") else None


def _flat(matrix: Array) -> str:
    return "[" + "; ".join(" ".join(f"{value:g}" for value in row) for row in matrix) + "]"
