"""A camera from numbers, a matrix file, a COLMAP model or EXIF, or guessed, which its `source` says."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import SupportsFloat

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import Failed, InputError
from zpm2.files.listing import text as text_of
from zpm2.files.reading import WRONG, read_array, read_json
from zpm2.formats.colmap import camera_of, read_cameras
from zpm2.model import Camera
from zpm2.model.camera import Source
from zpm2.photos import pictures
from zpm2.stereo.camera_check import OFF_CENTRE, ON_CENTRE, checked, fitting_size, off_centre

Array = NDArray[np.float64]
Size = tuple[int, int]  # width, height, px

GUESSED_FOCAL = 1.2  # times the longer side: COLMAP's default, a field of view of 45 degrees
FULL_FRAME = 43.266615  # mm, diagonal of 36 x 24 mm, to which "35 mm equivalent" refers (CIPA DCG-001)
MODEL, UNITS = 0x0110, {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # mm per unit of resolution
FOCAL, FOCAL_35, PLANE_X, PLANE_UNIT, WIDTH, HEIGHT = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003
SHAPES = {9: (3, 3), 12: (3, 4), 16: (4, 4)}  # of a matrix by its numbers
OTHER_ORDERS = {"fx,cx,fy,cy": (0, 2, 1, 3), "cx,cy,fx,fy": (2, 3, 0, 1)}  # and where our four are in them
SQUARE_TOLERANCE = 0.05  # share by which two focal lengths of square pixels may differ


def read_camera(text: str, image: str | Path, size: Size, centers: float = 0.5, name: str = "K") -> Camera:
    """The camera that `text` describes, for an image of `size` px as its file stores them (no EXIF orientation).

    text: "fx,fy,cx,cy" and the coefficients of distortion that there are (k1[,k2[,p1,p2[,k3[,k4,k5,k6]]]]); a file with
        a matrix (3 x 3, or 3 x 4 or 4 x 4 with it in the corner, as text or .npy; JSON with "matrix" and maybe
        "distortion", "width", "height"); a COLMAP model (its folder, cameras.txt or cameras.bin); "exif"; or "guess", a
        focal length of 1.2 times the longer side.
    centers: coordinate of the centre of the first pixel for the numbers or the matrix: 0.5, as COLMAP, or 0 (OpenCV).

    `InputError` calls the camera `name` and says what is wrong, for example that it fits another size, or the image as
    its EXIF orientation shows it.
    """
    if text in ("exif", "guess"):
        found = from_exif(image, size) if text == "exif" else guess(size)
        if isinstance(found, Failed):
            raise InputError(f"--{name} exif: {found.reason}; give --{name} as numbers, a file, or guess")
        return found
    path = Path(text)
    if os.path.isdir(path) or path.name in ("cameras.txt", "cameras.bin"):
        named = camera_of(read_cameras(path), image, f"--{name} {path}")
        return checked(fitting_size(named, size, f"{name} of {path}", str(image)), name, str(image))
    values = _numbers(text.split(","))
    made_for = size
    if values is not None and len(values) >= 4:
        fx, fy, cx, cy = values[:4]
        matrix, distortion = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), values[4:]
        _refuse_other_order(values[:4], size, name)
    elif os.path.isfile(path):
        matrix, distortion, made_for = _from_file(path, name, size)
    else:
        raise InputError(
            f"--{name} '{text}' is neither a file nor fx,fy,cx,cy; give numbers in px, a matrix file, a COLMAP model, "
            "exif or guess"
        )
    if np.shape(matrix) == (3, 3):
        matrix = matrix + np.array([[0, 0, 0.5 - centers], [0, 0, 0.5 - centers], [0, 0, 0]])
    camera = Camera(np.asarray(matrix), made_for, np.asarray(distortion))
    return checked(fitting_size(camera, size, f"{name} of {path}", str(image)), name, str(image))


def refuse_swapped(cameras: tuple[Camera, Camera]) -> None:
    """`InputError` if each camera's principal point speaks against its own image and for the other one's."""
    (a, b), sizes = cameras, (cameras[0].size, cameras[1].size)
    if sizes[0] == sizes[1]:
        return
    mine = [off_centre(c, s) for c, s in zip((a, b), sizes, strict=True)]
    other = [off_centre(c, s) for c, s in zip((b, a), sizes, strict=True)]
    if max(mine) > OFF_CENTRE and max(other) < ON_CENTRE:
        raise InputError("K and K2 seem to be swapped: each principal point is the centre of the other image")


def guess(size: Size) -> Camera:
    """A camera of which nothing is known: focal length 1.2 times the longer side, principal point in the middle."""
    return centred(GUESSED_FOCAL * max(size), size, "guess")


def from_exif(image: str | Path, size: Size) -> Camera | Failed:
    """The focal length that the photograph's EXIF holds, with the principal point in the middle.

    From the 35 mm equivalent, which by CIPA's rule keeps the diagonal; else from the focal length and the resolution of
    the sensor; else, where pycolmap is installed, from its table of sensors by the camera's name.
    """
    try:
        with pictures.looked_at(image) as picture:
            exif = pictures.exif_of(picture)
            values = exif.get_ifd(pictures.EXIF_IFD)
    except pictures.DAMAGE as error:
        return Failed(f"the EXIF data of {image} cannot be read ({error})")
    diagonal = float(np.hypot(*size))
    if (equivalent := _positive(values.get(FOCAL_35, 0))) is not None:
        return centred(equivalent / FULL_FRAME * diagonal, size, "exif")
    focal, resolution = _positive(values.get(FOCAL, 0)), _positive(values.get(PLANE_X, 0))
    if focal is not None and resolution is not None and values.get(PLANE_UNIT) in UNITS:
        width, height = (_positive(values.get(tag, 0)) for tag in (WIDTH, HEIGHT))
        # by the longer sides, as programs that turn a photograph exchange its sides here or not
        shrunk = max(size) / max(width, height) if width and height else size[0] / (width or size[0])
        return centred(focal * resolution / UNITS[values[PLANE_UNIT]] * shrunk, size, "exif")
    if focal is not None and (found := _from_sensor_table(image, size)) is not None:
        return found
    known = f"focal length {focal:g} mm without the size of the sensor" if focal else "no focal length"
    return Failed(f"the EXIF data of {image} has {known}")


def _from_sensor_table(image: str | Path, size: Size) -> Camera | None:
    try:
        import pycolmap
    except ImportError:
        return None
    try:
        camera = pycolmap.infer_camera_from_image(str(image))
    except Exception:  # it decodes the pixels too, and raises whatever its libraries do for formats that only we read
        return None
    return centred(camera.mean_focal_length(), size, "exif") if camera.has_prior_focal_length else None


def _refuse_other_order(values: Array, size: Size, name: str) -> None:
    """`InputError` where the four numbers make a camera in another order and none in ours."""

    def plausible(order: Sequence[int]) -> bool:
        fx, fy, cx, cy = values[list(order)]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        square = fx > 0 and fy > 0 and abs(fx / fy - 1) < SQUARE_TOLERANCE
        return square and off_centre(Camera(matrix, size), size) < ON_CENTRE

    if np.isfinite(values).all() and not plausible(range(4)):
        for words, order in OTHER_ORDERS.items():
            if plausible(order):
                right = ",".join(f"{value:g}" for value in values[list(order)])
                raise InputError(f"--{name} has the order {words}: give fx,fy,cx,cy, that is {right}")


def _from_file(path: Path, name: str, size: Size) -> tuple[Array, Array, Size]:
    """The matrix of a file, the coefficients of distortion beside it, and the size that it was made for: `size`, if
    the file has none."""
    distortion = np.zeros(0)
    try:
        if path.suffix.lower() == ".npy":
            matrix = np.asarray(read_array(path), np.float64)
        elif path.suffix.lower() == ".json":
            values = read_json(path)
            matrix = np.array(values["matrix"], np.float64)
            distortion = np.array(values.get("distortion", ()), np.float64).ravel()
            size = int(values.get("width", size[0])), int(values.get("height", size[1]))
        else:
            lines = (line.partition("#")[0].replace(",", " ").split() for line in text_of(path).splitlines())
            flat = np.array([float(word) for words in lines for word in words])
            if len(flat) not in SHAPES:
                raise InputError(f"--{name} {path} holds {len(flat)} numbers: expected a 3 x 3 matrix")
            matrix = flat.reshape(SHAPES[len(flat)])
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except WRONG as error:
        raise InputError(f"--{name} {path} holds no camera matrix ({error!r}): give 3 x 3 numbers in px") from error
    if matrix.shape in ((3, 4), (4, 4)) and matrix[2, :3].tolist() == [0, 0, 1] and not matrix[1, 0]:
        matrix = matrix[:3, :3]  # K with nothing beside it, or the projection of a camera that is not turned
    return matrix, distortion, size


def centred(focal: float, size: Size, source: Source) -> Camera:
    """A camera with square pixels and its principal point in the middle of the image."""
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    return Camera(matrix, size, source=source)


def _numbers(words: Sequence[str]) -> Array | None:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return None


def _positive(value: SupportsFloat | str) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < float("inf") else None
