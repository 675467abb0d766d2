"""Whether a camera fits its image: impossible cameras are refused, unusual ones get a warning."""

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Camera
from zpm2.photos import pictures

Array = NDArray[np.float64]
Size = tuple[int, int]  # width, height, px

COEFFICIENT_COUNTS = (0, 1, 2, 4, 5, 8)  # of distortion: none, k1, k1 k2, k1 k2 p1 p2, and k3, and k4 k5 k6
# focal lengths of lenses that keep lines straight, and of usual ones, times the longer side
POSSIBLE_FOCAL, USUAL_FOCAL = (0.1, 200.0), (0.25, 20.0)
# distance of a principal point from the middle, of a side: too far for this image, and near enough for it
OFF_CENTRE, ON_CENTRE = 0.15, 0.08
MIN_OFFSET = 0.04  # the same, below which no other size is considered
SQUARE_PIXELS = 0.5, 2.0  # ratios of focal lengths outside of which pixels are unusually far from square
MAX_ROUND_TRIP = 1.0  # px by which a point at the border may move when its distortion is undone and applied again
MAX_SKEW = 0.01  # px by which the skew of K, which camera files may have by rounding, may move a point of the image
ORIENTATION = 0x0112  # the EXIF tag


def checked(camera: Camera, name: str = "K", image: str | None = None) -> Camera:
    """The same camera; `InputError` if it cannot be one of an image of its size.

    A camera belongs to the pixels as the file stores them, whatever its EXIF orientation: one for the image as viewers
    show it, with its sides exchanged, is refused. `image` is the file whose orientation the message names.
    """
    k, (width, height) = camera.matrix, camera.size
    if k.shape != (3, 3):
        raise InputError(f"{name} has shape {' x '.join(map(str, k.shape))}: expected a 3 x 3 matrix")
    if not np.isfinite(k).all() or not np.isfinite(camera.distortion).all():
        raise InputError(f"{name} has values that are not finite: {_flat(k)}; correct it")
    if not (k[0, 0] > 0 and k[1, 1] > 0):
        raise InputError(f"{name} has focal lengths {k[0, 0]:g} and {k[1, 1]:g} px: they must be positive")
    if k[1, 0] or k[2].tolist() != [0, 0, 1]:
        raise InputError(f"{name} must be [fx s cx; 0 fy cy; 0 0 1] in px, got {_flat(k)}")
    count = len(camera.distortion)
    if count not in COEFFICIENT_COUNTS:
        raise InputError(
            f"{name} has {count} coefficients of distortion: give k1; k1,k2; k1,k2,p1,p2; the same with k3; or the "
            "same with k3,k4,k5,k6"
        )
    if _turned(camera):
        raise InputError(
            f"{name} has its principal point at ({k[0, 2]:g}, {k[1, 2]:g}), which fits {height} x {width} px: the "
            f"image has {width} x {height} px{_shown(image)}; give the camera of the image as it is stored"
        )
    if not (0 < k[0, 2] < width and 0 < k[1, 2] < height):
        raise InputError(
            f"{name} has its principal point at ({k[0, 2]:g}, {k[1, 2]:g}), outside of the image of {width} x {height} "
            "px: was it made for another size, or are the two cameras swapped?"
        )
    longer = max(width, height)
    for focal in (k[0, 0], k[1, 1]):
        if not POSSIBLE_FOCAL[0] * longer < focal < POSSIBLE_FOCAL[1] * longer:
            raise InputError(f"{name} has a focal length of {focal:g} px for {width} x {height} px: it must be in px")
    skewed = abs(k[0, 1]) / k[1, 1] * max(k[1, 2], height - k[1, 2])
    if skewed > MAX_SKEW:
        raise InputError(
            f"{name} has a skew of {k[0, 1]:g}, which moves points by up to {skewed:.2g} px: resample the photograph "
            "to pixels without skew, and give K with 0 there"
        )
    return camera


def fitting_size(camera: Camera, size: Size, name: str, image: str) -> Camera:
    """The same camera; `InputError` if the size that it was made for is not that of `image`, (width, height) px."""
    if camera.size != size:
        shown = _shown(image) if camera.size == size[::-1] else ""
        raise InputError(
            f"{name} is for an image of {camera.size[0]} x {camera.size[1]} px, {image} has {size[0]} x {size[1]} px"
            f"{shown}: give the camera of this size"
        )
    return camera


def doubts(camera: Camera, name: str = "K") -> list[str]:
    """What is unusual about a camera that `checked` accepts, in sentences."""
    k, (width, height), warnings = camera.matrix, camera.size, []
    where = f"of the image of {width} x {height} px"
    off = off_centre(camera, camera.size)
    if off > OFF_CENTRE:
        warnings.append(
            f"{name} has its principal point at ({k[0, 2]:g}, {k[1, 2]:g}), {100 * off:.0f} % of a side from the "
            f"middle {where}: was it made for another size?"
        )
    low, high = USUAL_FOCAL
    if not low * max(width, height) <= camera.focal <= high * max(width, height):
        warnings.append(f"{name} has a focal length of {camera.focal:g} px, unusual for the size {where}: is it in px?")
    if not SQUARE_PIXELS[0] < k[0, 0] / k[1, 1] < SQUARE_PIXELS[1]:
        warnings.append(
            f"{name} has focal lengths {k[0, 0]:g} and {k[1, 1]:g} px: pixels are rarely that far from square"
        )
    moved = _moved(camera)
    if not moved <= MAX_ROUND_TRIP:
        warnings.append(
            f"{name} has a distortion that cannot be undone at the border {where} (off by {moved:.0f} px): are these "
            "its coefficients?"
        )
    return warnings


def orientation(image: str | None) -> int:
    """The EXIF orientation of a picture file, 1 to 8; 1 where it cannot be read."""
    if image is None:
        return 1
    try:
        with pictures.looked_at(image) as picture:
            value = pictures.exif_of(picture).get(ORIENTATION, 1)
    except pictures.DAMAGE:
        return 1
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def off_centre(camera: Camera, size: Size) -> float:
    """How far the principal point is from the middle of an image of `size`, as a share of its side."""
    return float(np.abs(camera.matrix[:2, 2] / np.array(size) - 0.5).max())


def _turned(camera: Camera) -> bool:
    """Whether the principal point fits the image with its sides exchanged."""
    here, there = off_centre(camera, camera.size), off_centre(camera, camera.size[::-1])
    return there < ON_CENTRE and here > max(MIN_OFFSET, 2 * there)


def _shown(image: str | None) -> str:
    turn = orientation(image)
    return f", and is turned only when it is shown (EXIF orientation {turn})" if turn >= 5 else ""


def _moved(camera: Camera) -> float:
    """px by which points along the border move when the distortion is undone and applied again."""
    if not camera.distortion.any():
        return 0.0
    t, (width, height) = np.linspace(0, 1, 9), camera.size
    border = np.concatenate([np.c_[t, 0 * t], np.c_[t, 0 * t + 1], np.c_[0 * t, t], np.c_[0 * t + 1, t]])
    border = border * [width, height]
    away = np.linalg.norm(camera.pixels(camera.rays(border)) - border, axis=1)
    return float(np.where(np.isfinite(away), away, np.inf).max())


def _flat(matrix: Array) -> str:
    return "[" + "; ".join(" ".join(f"{value:g}" for value in row) for row in matrix) + "]"
