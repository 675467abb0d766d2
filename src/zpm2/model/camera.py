"""A calibrated camera."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from zpm2.model.brief import brief

Array = NDArray[np.float64]
Source = Literal["given", "exif", "estimated", "guess"]

_FINE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with the radial and tangential distortion of Brown and Conrady, as in OpenCV and COLMAP."""

    matrix: Array  # (3, 3) K without skew, px of the original image, pixel centres at +0.5
    size: tuple[int, int]  # (width, height) of the image, px
    distortion: Array = field(default_factory=lambda: np.zeros(0))  # k1 [k2 [p1 p2 [k3 [k4 k5 k6]]]]; empty: none
    source: Source = "given"  # where the focal length comes from

    __repr__ = brief

    @property
    def focal(self) -> float:
        """px, the mean of both axes."""
        return float(self.matrix[[0, 1], [0, 1]].mean())

    @property
    def coefficients(self) -> Array:
        """The distortion as OpenCV wants it: 4, 5 or 8 numbers."""
        return np.r_[self.distortion, np.zeros(max(0, 4 - len(self.distortion)))]

    @cached_property
    def _fold(self) -> float:
        """The radius of x / z, y / z at which the radial distortion r d(r) stops growing; infinite if it never does."""
        k1, k2, _, _, k3, k4, k5, k6 = np.r_[self.coefficients, np.zeros(8 - len(self.coefficients))]
        above, below, square = Polynomial([1, k1, k2, k3]), Polynomial([1, k4, k5, k6]), Polynomial([0, 1])  # of r^2
        slope = above * below + 2 * square * (above.deriv() * below - above * below.deriv())
        ends = np.r_[slope.roots(), below.roots()]
        return float(np.sqrt(min(ends[np.isreal(ends) & (ends.real > 0)].real, default=np.inf)))

    def rays(self, points: Array) -> Array:
        """(n, 2) image px -> (n, 2) x / z, y / z in the camera's frame, without distortion."""
        if len(points) == 0:
            return np.zeros((0, 2))
        if not self.distortion.any():
            return np.asarray((np.c_[points, np.ones(len(points))] @ np.linalg.inv(self.matrix).T)[:, :2])
        undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # OpenCV 4, OpenCV 5
        straight = undistort(
            np.ascontiguousarray(points)[:, None],
            self.matrix,
            self.coefficients,
            R=np.eye(3),
            P=np.eye(3),
            criteria=_FINE,
        )
        return np.asarray(straight[:, 0], np.float64)

    def pixels(self, rays: Array) -> Array:
        """(n, 2) x / z, y / z -> (n, 2) image px, distorted."""
        if len(rays) == 0:
            return np.zeros((0, 2))
        if not self.distortion.any():
            return np.asarray(rays @ self.matrix[:2, :2].T + self.matrix[:2, 2])
        space = np.c_[rays, np.ones(len(rays))]
        bent, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), self.matrix, self.coefficients)
        return np.asarray(bent[:, 0], np.float64)

    def to_dict(self) -> dict[str, object]:
        """The camera as it is written to result files."""
        return {
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "width": self.size[0],
            "height": self.size[1],
            "source": self.source,
        }


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """A camera in the world: X_cam = R X_world + t."""

    camera: Camera
    rotation: Array  # (3, 3) R
    translation: Array  # (3,) t

    __repr__ = brief

    @property
    def center(self) -> Array:
        """(3,) the projection centre, O = -R^T t."""
        return np.asarray(-self.rotation.T @ self.translation)

    def directions(self, points: Array) -> Array:
        """(n, 2) image px -> (n, 3) directions of sight in the world, one unit of depth long (paper, Eq. raydir)."""
        return np.asarray(np.c_[self.camera.rays(points), np.ones(len(points))] @ self.rotation)

    def project(self, space: Array) -> Array:
        """(n, 3) world -> (n, 2) image px.

        NaN for points behind the camera, and for those so far off its axis that the radial distortion would fold them
        back towards the image.
        """
        p = space @ self.rotation.T + self.translation
        before = p[:, 2] > 0
        if self.camera.distortion.any():
            before &= np.linalg.norm(p[:, :2], axis=1) / self.camera._fold < p[:, 2]
        pixels = np.full((len(p), 2), np.nan)
        pixels[before] = self.camera.pixels(p[before, :2] / p[before, 2:])
        return pixels
