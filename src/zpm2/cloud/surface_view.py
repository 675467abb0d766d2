"""A view of a surface: a camera, the mesh that it sees, and a caster for its rays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.surface import SurfaceMesh
from zpm2.model import PosedCamera

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """A camera and the surface that it sees."""

    camera: PosedCamera
    surface: SurfaceMesh
    caster: RayCaster  # of that surface

    @property
    def center(self) -> Array:
        """(3,) the camera's centre in the surface's coordinates."""
        return np.asarray(self.camera.center - self.surface.origin)

    def cast(self, pixels: Array) -> Hits:
        """The first hits of the lines of sight through pixels (n, 2) (paper, Eq. raydir)."""
        origins = np.broadcast_to(self.center, (len(pixels), 3))
        return self.caster.first_hits(origins, self.camera.directions(pixels))

    def cast_grid(self, count: int) -> Hits:
        """The first hits of about `count` rays, on a grid over the image."""
        width, height = self.camera.camera.size
        step = max((width * height / count) ** 0.5, 1.0)
        x, y = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step))
        return self.cast(np.c_[x.ravel(), y.ravel()])

    def depths(self, points: Array) -> Array:
        """(n,) depths of points (n, 3) of the surface along the camera's axis."""
        camera = self.camera
        return np.asarray((points + self.surface.origin) @ camera.rotation[2] + camera.translation[2])
