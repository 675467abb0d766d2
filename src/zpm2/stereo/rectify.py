"""The pair and its polygons as a rectified stereo pair: homologous points in the same row (for dense stereo)."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.errors import Failed
from zpm2.model import Camera, Image, Polygon
from zpm2.model.brief import brief

Array = NDArray[np.float64]
LARGEST = 2.0  # of an original side: a rectified image that would be larger is reduced
STEEP = 60.0  # degrees that a view may turn


@dataclass(frozen=True, eq=False)
class RectifiedSide:
    """One rectified view, a pinhole without distortion."""

    image: Image
    polygons: Sequence[Polygon]  # those that were matched, rectified px; ids as before
    camera: Camera  # K of the rectified view
    rotation: Array  # (3, 3) from the original camera's frame to the rectified one's

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Both views: homologous points have the same y (the same x, where `vertical`).

    With cx of either K, depth = focal * baseline / |(x_left - cx_left) - (x_right - cx_right)|.
    """

    left: RectifiedSide
    right: RectifiedSide
    vertical: bool  # the cameras lie above each other: homologous points share their column, not their row
    projection: tuple[Array, Array]  # (3, 4) P of each view in the left rectified frame

    __repr__ = brief

    def to_dict(self) -> dict[str, Any]:
        """What a dense matcher needs to know (rectification.json)."""
        sides = {
            name: {
                "matrix": side.camera.matrix.tolist(),
                "rotation": side.rotation.tolist(),
                "projection": projection.tolist(),
            }
            for name, side, projection in zip(("left", "right"), (self.left, self.right), self.projection, strict=True)
        }
        return {"schema": "zpm2-rectification/1", "vertical": self.vertical, **sides}


def rectify(
    cameras: tuple[Camera, Camera],
    rotation: Array,
    translation: Array,
    points: tuple[Array, Array],
    images: tuple[Image, Image],
    polygons: tuple[Sequence[Polygon], Sequence[Polygon]],
) -> RectifiedPair | Failed:
    """The rectified pair (Bouguet's method, OpenCV's stereoRectify) in which the homologous points are seen whole.

    rotation (3, 3), translation (3,): of the right camera from the left one. points: (n, 2) image px of either side.
    images: the originals. polygons: the matched ones of either side; vertices are moved one by one, so that straight
    edges stay straight, and with distortion, the curves between them are those of the vertices. `Failed` where a camera
    moved along its own line of sight, so that no such pair exists.
    """
    found = _turns(rotation, translation)
    if found is None:
        return Failed("a camera moved along its own line of sight: no rectified pair shows both views")
    *turns, along = found
    rectified = _cameras(cameras, points, turns, along)
    left, right = (
        RectifiedSide(_drawn(image, original, turn, camera), _moved(shapes, original, turn, camera), camera, turn)
        for image, original, turn, camera, shapes in zip(images, cameras, turns, rectified, polygons, strict=True)
    )
    shifts = np.zeros(3), turns[1] @ translation
    first, second = (c.matrix @ np.c_[np.eye(3), shift] for c, shift in zip(rectified, shifts, strict=True))
    return RectifiedPair(left, right, along == 1, (first, second))


def _cameras(
    originals: tuple[Camera, Camera], points: tuple[Array, Array], turns: Sequence[Array], along: int
) -> list[Camera]:
    """The rectified cameras: of one focal length and size, each with its own offset along the baseline."""
    seen = [_seen(*of) for of in zip(originals, turns, points, strict=True)]
    low, high = np.array([s.min(0) for s in seen]), np.array([s.max(0) for s in seen])
    low[:, 1 - along], high[:, 1 - along] = low[:, 1 - along].min(), high[:, 1 - along].max()
    focal, extent = min(camera.focal for camera in originals), (high - low).max(0)
    focal *= min(1.0, LARGEST * max(max(camera.size) for camera in originals) / float(extent.max() * focal))
    size = max(1, int(np.ceil(extent[0] * focal))), max(1, int(np.ceil(extent[1] * focal)))
    matrices = [np.array([[focal, 0, -x * focal], [0, focal, -y * focal], [0, 0, 1.0]]) for x, y in low]
    return [Camera(k, size, source=camera.source) for k, camera in zip(matrices, originals, strict=True)]


def _seen(camera: Camera, turn: Array, points: Array) -> Array:
    """(n, 2) rectified rays of the image's border, as far as it does not turn out of sight, and of its points."""
    width, height = camera.size
    x, y = np.linspace(0, width, 20), np.linspace(0, height, 20)
    border = np.concatenate([np.c_[x, 0 * x], np.c_[x, 0 * x + height], np.c_[0 * y, y], np.c_[0 * y + width, y]])
    rays = geometry.homogeneous(camera.rays(border)) @ turn.T
    rays = rays[rays[:, 2] > np.cos(np.radians(STEEP)) * np.linalg.norm(rays, axis=1)]
    inside = geometry.turn_rays(turn, camera.rays(points))
    return np.concatenate([rays[:, :2] / rays[:, 2:], inside[np.isfinite(inside).all(1)]])


def _drawn(image: Image, original: Camera, turn: Array, camera: Camera) -> Image:
    to_opencv = np.linalg.inv(geometry.HALF_PIXEL)
    maps = cv2.initUndistortRectifyMap(
        to_opencv @ original.matrix, original.coefficients, turn, to_opencv @ camera.matrix, camera.size, cv2.CV_32FC1
    )
    return Image(np.asarray(cv2.remap(image.rgb, *maps, cv2.INTER_LINEAR), np.uint8))


def _moved(polygons: Sequence[Polygon], original: Camera, turn: Array, camera: Camera) -> list[Polygon]:
    """The polygons in the rectified view, without those of which a part turned out of sight."""
    moved = []
    for polygon in polygons:
        rays = [geometry.turn_rays(turn, original.rays(ring)) for ring in (polygon.exterior, *polygon.holes)]
        if all(np.isfinite(ring).all() for ring in rays):
            exterior, *holes = (camera.pixels(ring) for ring in rays)
            moved.append(dataclasses.replace(polygon, exterior=exterior, holes=tuple(holes)))
    return moved


def _turns(rotation: Array, translation: Array) -> tuple[Array, Array, int] | None:
    """Rotations of the left and right camera's frames to a common one whose axis 0 (1, for cameras above each other)
    lies along the baseline, and which one it is; None where the views would turn too far."""
    half, _ = cv2.Rodrigues(cv2.Rodrigues(rotation)[0] * 0.5)
    direction = half.T @ translation  # of the baseline from halfway: half^T X_right = half X_left + half^T t
    axis = int(np.argmax(np.abs(direction[:2])))
    target = np.eye(3)[axis] * (np.sign(direction[axis]) or 1.0)
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(direction, target)), direction @ target))
    if angle > STEEP:
        return None
    across = np.cross(direction, target)
    length = np.linalg.norm(across)
    turn = np.eye(3)
    if length > 1e-12:
        turn, _ = cv2.Rodrigues(across / length * np.arctan2(length, direction @ target))
    return np.asarray(turn @ half), np.asarray(turn @ half.T), axis
