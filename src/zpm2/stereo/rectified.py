"""Two calibrated views turned so that the rows of both are epipolar lines."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.errors import Failed
from zpm2.geometry import for_opencv, homogeneous
from zpm2.model import Camera, Image, PosedCamera
from zpm2.stereo.rig import Rig

Array = NDArray[np.float64]
LARGEST = 2.0  # times the width and the height of the image: more stretched pairs are refused
FORWARD = 0.5  # cosine of baseline and optical axis, from which on the pair cannot be rectified


@dataclass(frozen=True, eq=False)
class RectifiedViews:
    """Both views as a rig; its left one is the reference, its frame is turned by `rotation` against the world."""

    rig: Rig
    rotation: Array  # (3, 3) world to rectified frame
    reference: PosedCamera
    homographies: tuple[Array, Array]  # (3, 3) rectified px -> original px, pixel centres at +0.5
    search: tuple[int, int]  # px of disparity

    def images(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both photographs, rectified; black where they show nothing."""
        return self._drawn(left, 0), self._drawn(right, 1)

    def _drawn(self, image: Image, side: int) -> Image:
        matrix = for_opencv(self.homographies[side])
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return Image(np.asarray(cv2.warpPerspective(image.rgb, matrix, self.rig.left.size, flags=how), np.uint8))

    def depth(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """(h, w) depth in the reference camera for each of its pixels, NaN where it is not known."""
        width, height = self.reference.camera.size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        there = homogeneous(np.c_[x.ravel(), y.ravel()]) @ np.linalg.inv(self.homographies[0]).T
        there = there[:, :2] / there[:, 2:]
        column, row = np.floor(there).astype(np.intp).T
        inside = (column >= 0) & (row >= 0) & (column < disparity.shape[1]) & (row < disparity.shape[0])
        found = np.full(len(there), np.nan, np.float64)
        found[inside] = disparity[row[inside], column[inside]]
        z = self.rig.depth(found)
        points = np.c_[self.rig.left.rays(there), np.ones(len(there))] * z[:, None]
        depth = points @ (self.reference.rotation @ self.rotation.T)[2]
        return np.where(depth > 0, depth, np.nan).reshape(height, width).astype(np.float32)


def rectify_views(reference: PosedCamera, other: PosedCamera, points: Array) -> RectifiedViews | Failed:
    """Rectifies two views without distortion. points: (n, 3) world, that say where disparities are to be looked for."""
    baseline = other.center - reference.center
    length = float(np.linalg.norm(baseline))
    axis = reference.rotation[2] + other.rotation[2]
    if length == 0 or abs(baseline @ axis) > FORWARD * length * float(np.linalg.norm(axis)):
        return Failed("the cameras moved along their axis")
    x = baseline / length
    z = axis - (axis @ x) * x
    z /= np.linalg.norm(z)
    rotation = np.stack([x, np.cross(z, x), z])
    focal = reference.camera.focal
    corners = _seen(reference, rotation)
    if corners is None:
        return Failed("the cameras look into too different directions")
    low, high = (corners * focal).min(0), (corners * focal).max(0)
    width, height = np.ceil(high - low).astype(int)
    if width > LARGEST * max(reference.camera.size) or height > LARGEST * max(reference.camera.size):
        return Failed("the cameras look into too different directions")
    depth = (points - reference.center) @ rotation[2]
    shift = focal * length / depth[depth > 0]
    if len(shift) < 8:
        return Failed("too few points before both cameras")
    near, far = np.percentile(shift, [1, 99])
    margin = max(0.15 * (far - near), 8.0)
    middle = (near + far) / 2
    size = int(width), int(height)
    matrix = np.array([[focal, 0, -low[0]], [0, focal, -low[1]], [0, 0, 1]])
    right = matrix.copy()
    right[0, 2] += middle
    rig = Rig(Camera(matrix, size), Camera(right, size), length)
    maps = tuple(
        view.camera.matrix @ view.rotation @ rotation.T @ np.linalg.inv(k)
        for view, k in ((reference, matrix), (other, right))
    )
    search = int(np.floor(near - middle - margin)), int(np.ceil(far - middle + margin))
    return RectifiedViews(rig, rotation, reference, (maps[0], maps[1]), search)


def _seen(view: PosedCamera, rotation: Array) -> Array | None:
    """(k, 2) rays x / z, y / z of the image's border in the rectified frame; None where some point backwards."""
    width, height = view.camera.size
    t = np.linspace(0, 1, 9)[:, None]
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
    border = np.concatenate([a + (b - a) * t for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    rays = view.directions(border) @ rotation.T
    return None if (rays[:, 2] <= 0.1).any() else rays[:, :2] / rays[:, 2:]
