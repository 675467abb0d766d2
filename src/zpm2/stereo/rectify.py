"""Epipolar rectification: two views turned about their centres so that homologous points share a row.

Two kinds of pairs come here. Two photographs with a relative pose (`rectify`) may have distortion and lie above each
other, and are drawn large enough for both: Bouguet's method, as OpenCV's stereoRectify. Two undistorted views of a
reconstruction (`rectify_views`) are drawn as far as the first one reaches, for its depth map.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import StereoConfig
from zpm2.errors import Failed
from zpm2.model import Camera, Image, Polygon, PosedCamera
from zpm2.model.brief import brief
from zpm2.stereo.dense import robust_range
from zpm2.stereo.rig import Rig

Array = NDArray[np.float64]
MAX_SIDE = 32766  # px of an image that cv2.remap reads or makes


@dataclass(frozen=True, eq=False)
class RectifiedImage:
    """One rectified photograph, a pinhole without distortion."""

    image: Image
    polygons: Sequence[Polygon]  # those that were matched, rectified px; ids as before
    camera: Camera  # K of the rectified view
    rotation: Array  # (3, 3) from the original camera's frame to the rectified one's

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Both photographs: homologous points have the same y (the same x, where `vertical`).

    With cx of either K, depth = focal * baseline / |(x_left - cx_left) - (x_right - cx_right)|.
    """

    left: RectifiedImage
    right: RectifiedImage
    vertical: bool  # the cameras lie above each other: homologous points share their column, not their row
    projection: tuple[Array, Array]  # (3, 4) P of each view in the left rectified frame

    __repr__ = brief

    def to_dict(self) -> dict[str, object]:
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


@dataclass(frozen=True, eq=False)
class RectifiedViews:
    """Two undistorted views as a rig; the left one is the reference, whose depth is wanted."""

    rig: Rig
    rotation: Array  # (3, 3) world to rectified frame
    reference: PosedCamera
    homographies: tuple[Array, Array]  # (3, 3) rectified px -> original px, pixel centres at +0.5
    search: tuple[int, int]  # px, lowest and highest disparity

    def images(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both photographs, rectified; black outside of them."""
        return self._warped(left, 0), self._warped(right, 1)

    def _warped(self, image: Image, side: int) -> Image:
        matrix = geometry.for_opencv(self.homographies[side])
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return Image(np.asarray(cv2.warpPerspective(image.rgb, matrix, self.rig.left.size, flags=how), np.uint8))

    def depth(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """(h, w) depth in the reference camera for each of its pixels, NaN where it is not known."""
        width, height = self.reference.camera.size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        there = geometry.homogeneous(np.c_[x.ravel(), y.ravel()]) @ np.linalg.inv(self.homographies[0]).T
        there = there[:, :2] / there[:, 2:]
        column, row = np.floor(there).astype(np.intp).T
        inside = (column >= 0) & (row >= 0) & (column < disparity.shape[1]) & (row < disparity.shape[0])
        found = np.full(len(there), np.nan, np.float64)
        found[inside] = disparity[row[inside], column[inside]]
        z = self.rig.depth(found)
        points = np.c_[self.rig.left.rays(there), np.ones(len(there))] * z[:, None]
        depth = points @ (self.reference.rotation @ self.rotation.T)[2]
        return np.where(depth > 0, depth, np.nan).reshape(height, width).astype(np.float32)


def rectify(
    cameras: tuple[Camera, Camera],
    motion: tuple[Array, Array],
    points: tuple[Array, Array],
    images: tuple[Image, Image],
    polygons: tuple[Sequence[Polygon], Sequence[Polygon]],
    config: StereoConfig,
) -> RectifiedPair | Failed:
    """The rectified pair of two photographs, in which the homologous points are seen whole.

    motion: (3, 3) R and (3,) t of the right camera, seen from the left one. points: (n, 2) image px of either side.
    images: the originals. polygons: the matched ones of either side. Their vertices are moved one by one: straight
    edges stay straight; under distortion the true edges are curves between the moved vertices. `Failed` where a camera
    moved along its own line of sight: no rectified pair shows both views; or where an image has too long a side to be
    resampled.
    """
    found = _bouguet(*motion, config)
    if found is None:
        return Failed("a camera moved along its own line of sight: no rectified pair shows both views")
    rotations, axis = found
    rectified = _pair_cameras(cameras, points, rotations, axis, config)
    before, after = (max(side for camera in of for side in camera.size) for of in (cameras, rectified))
    if before > MAX_SIDE:
        return Failed(f"a photograph has a side of {before} px, more than {MAX_SIDE} px: reduce it, and K with it")
    if after > MAX_SIDE:
        return Failed(
            f"a rectified image would have a side of {after} px, more than {MAX_SIDE} px: make stereo.rectified_size "
            "smaller"
        )
    left, right = (
        RectifiedImage(
            _resampled(image, original, rotation, camera), _moved(shapes, original, rotation, camera), camera, rotation
        )
        for image, original, rotation, camera, shapes in zip(
            images, cameras, rotations, rectified, polygons, strict=True
        )
    )
    shifts = np.zeros(3), rotations[1] @ motion[1]
    first, second = (c.matrix @ np.c_[np.eye(3), shift] for c, shift in zip(rectified, shifts, strict=True))
    return RectifiedPair(left, right, axis == 1, (first, second))


def rectify_views(
    reference: PosedCamera, other: PosedCamera, points: Array, margin: float, config: StereoConfig
) -> RectifiedViews | Failed:
    """Two posed views without distortion as a rig.

    points: (n, 3) in the world; their disparities, and `margin` times the range of them on both sides, are searched.
    `Failed` where one camera stands in front of the other, where they look into different directions, or with too few
    points before both.
    """
    baseline = other.center - reference.center
    length = float(np.linalg.norm(baseline))
    axis = reference.rotation[2] + other.rotation[2]
    if length == 0 or abs(baseline @ axis) > config.max_forward * length * float(np.linalg.norm(axis)):
        return Failed("the cameras moved along their axis")
    rotation = _frame(baseline / length, axis)
    focal = reference.camera.focal
    rays = reference.directions(_border(reference.camera.size, config.view_border)) @ rotation.T
    if (rays[:, 2] <= config.min_ray_depth).any():  # parts of the border point sideways or backwards
        return Failed("the cameras look into too different directions")
    reach = rays[:, :2] / rays[:, 2:]
    low, high = reach.min(0), reach.max(0)
    width, height = np.ceil(high * focal - low * focal).astype(int)
    if max(width, height) > config.rectified_size * max(reference.camera.size):
        return Failed("the cameras look into too different directions")
    depth = (points - reference.center) @ rotation[2]
    disparities = focal * length / depth[depth > 0]
    if len(disparities) < config.min_range_points:
        return Failed("too few points before both cameras")
    near, far, extra = robust_range(disparities, margin, config)
    middle = (near + far) / 2  # the right image is shifted by it, so that the search is around 0
    matrix = _calibration(focal, low)
    right = matrix.copy()
    right[0, 2] += middle
    size = int(width), int(height)
    rig = Rig(Camera(matrix, size), Camera(right, size), length)
    maps = tuple(
        view.camera.matrix @ view.rotation @ rotation.T @ np.linalg.inv(k)
        for view, k in ((reference, matrix), (other, right))
    )
    search = int(np.floor(near - middle - extra)), int(np.ceil(far - middle + extra))
    return RectifiedViews(rig, rotation, reference, (maps[0], maps[1]), search)


def _border(size: tuple[int, int], count: int) -> Array:
    """(4 * count, 2) px along the border of an image."""
    width, height = size
    x, y = np.linspace(0, width, count), np.linspace(0, height, count)
    return np.concatenate([np.c_[x, 0 * x], np.c_[x, 0 * x + height], np.c_[0 * y, y], np.c_[0 * y + width, y]])


def _calibration(focal: float, low: Array) -> Array:
    """(3, 3) K of a rectified image whose corner sees the ray `low` (x / z, y / z)."""
    return np.array([[focal, 0, -low[0] * focal], [0, focal, -low[1] * focal], [0, 0, 1.0]])


def _frame(x: Array, axis: Array) -> Array:
    """(3, 3) the rotation into a frame whose x is given, and whose z is as near to `axis` as that allows."""
    z = axis - (axis @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _bouguet(rotation: Array, translation: Array, config: StereoConfig) -> tuple[tuple[Array, Array], int] | None:
    """Rotations of the left and right camera's frames to a common one whose axis 0 (1, for cameras above each other)
    lies along the baseline, and which one it is; None where the views would turn too far."""
    half, _ = cv2.Rodrigues(cv2.Rodrigues(rotation)[0] * 0.5)
    direction = half.T @ translation  # of the baseline from halfway: half^T X_right = half X_left + half^T t
    axis = int(np.argmax(np.abs(direction[:2])))
    target = np.eye(3)[axis] * (np.sign(direction[axis]) or 1.0)
    across = np.cross(direction, target)
    length = np.linalg.norm(across)
    angle = np.arctan2(length, direction @ target)
    if np.degrees(angle) > config.max_turn:
        return None
    turn = np.eye(3)
    if length > 1e-12:
        turn, _ = cv2.Rodrigues(across / length * angle)
    return (np.asarray(turn @ half), np.asarray(turn @ half.T)), axis


def _pair_cameras(
    originals: tuple[Camera, Camera],
    points: tuple[Array, Array],
    rotations: tuple[Array, Array],
    axis: int,
    config: StereoConfig,
) -> list[Camera]:
    """The rectified cameras: of one focal length and size, each with its own offset along the baseline."""
    seen = [
        _reach(camera, rotation, inside, config)
        for camera, rotation, inside in zip(originals, rotations, points, strict=True)
    ]
    low, high = np.array([s.min(0) for s in seen]), np.array([s.max(0) for s in seen])
    low[:, 1 - axis], high[:, 1 - axis] = low[:, 1 - axis].min(), high[:, 1 - axis].max()
    focal, extent = min(camera.focal for camera in originals), (high - low).max(0)
    longest = max(max(camera.size) for camera in originals)
    focal *= min(1.0, config.rectified_size * longest / float(extent.max() * focal))  # a larger image is reduced
    size = max(1, int(np.ceil(extent[0] * focal))), max(1, int(np.ceil(extent[1] * focal)))
    return [
        Camera(_calibration(focal, corner), size, source=camera.source)
        for corner, camera in zip(low, originals, strict=True)
    ]


def _reach(camera: Camera, rotation: Array, points: Array, config: StereoConfig) -> Array:
    """(n, 2) rectified rays of the image's border, as far as it does not turn out of sight, and of its points."""
    rays = geometry.homogeneous(camera.rays(_border(camera.size, config.pair_border))) @ rotation.T
    rays = rays[rays[:, 2] > np.cos(np.radians(config.max_turn)) * np.linalg.norm(rays, axis=1)]
    inside = geometry.turn_rays(rotation, camera.rays(points))
    return np.concatenate([rays[:, :2] / rays[:, 2:], inside[np.isfinite(inside).all(1)]])


def _resampled(image: Image, original: Camera, rotation: Array, camera: Camera) -> Image:
    """The photograph as the rectified camera sees it, its distortion undone."""
    half_pixel = np.linalg.inv(geometry.HALF_PIXEL)
    k, new_k = half_pixel @ original.matrix, half_pixel @ camera.matrix
    maps = cv2.initUndistortRectifyMap(k, original.coefficients, rotation, new_k, camera.size, cv2.CV_32FC1)
    return Image(np.asarray(cv2.remap(image.rgb, *maps, cv2.INTER_LINEAR), np.uint8))


def _moved(polygons: Sequence[Polygon], original: Camera, rotation: Array, camera: Camera) -> list[Polygon]:
    """The polygons in the rectified view, without those of which a part turned out of sight."""
    moved = []
    for polygon in polygons:
        rays = [geometry.turn_rays(rotation, original.rays(ring)) for ring in (polygon.exterior, *polygon.holes)]
        if all(np.isfinite(ring).all() for ring in rays):
            exterior, *holes = (camera.pixels(ring) for ring in rays)
            moved.append(dataclasses.replace(polygon, exterior=exterior, holes=tuple(holes)))
    return moved
