"""Where a photograph lies on the ground, as far as its file says."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.model.brief import brief

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Georeference:
    """A coordinate reference system, the affine map into it, and the size of a pixel, as far as they are known."""

    crs: str | None = None  # "EPSG:32632", or WKT where it has no code
    transform: Array | None = None  # (2, 3) from image px to coordinates of `crs`, as GDAL's geotransform
    gsd: float | None = None  # m on the ground per px; None where nothing says it
    rpc: Mapping[str, object] | None = None  # rational polynomial coefficients, by GDAL's names in lower case

    __repr__ = brief

    def to_world(self, points: Array) -> Array:
        """(n, 2) image px -> (n, 2) coordinates of `crs`."""
        assert self.transform is not None
        return np.asarray(points @ self.transform[:, :2].T + self.transform[:, 2])

    def to_image(self, points: Array) -> Array:
        """(n, 2) coordinates of `crs` -> (n, 2) image px."""
        assert self.transform is not None
        return np.asarray((points - self.transform[:, 2]) @ np.linalg.inv(self.transform[:, :2]).T)

    @property
    def located(self) -> bool:
        """Whether pixels have coordinates in a known reference system."""
        return self.crs is not None and self.transform is not None
