"""Where each polygon should be in the other image, coarsely (paper 3.3)."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option


@dataclass(frozen=True)
class GlobalConfig:
    """Initial geometry and bidirectional pyramid (paper 3.3, Algorithm 1)."""

    epipolar_px: float = number(3.0, 'MAGSAC++ threshold of F and the "sufficiently close" of 3.3.1', unit="px")
    homography_px: float = number(6.0, "MAGSAC++ threshold of H", unit="px")
    search: Literal["pyramid", "fixed"] = option(
        "pyramid", "fixed: a window as wide as the polygon's shorter side (4.4.1)"
    )
    factor: int = number(3, "pyramid downsampling factor", low=2, high=10)
    top_size: int = number(
        200, "downsampling stops when a side of the top level is no longer than this", unit="px", low=1
    )
    max_layers: int = number(10, "of the pyramid, full resolution included", low=1, high=100)
    phi: int = number(15, "template window W_phi, odd", unit="px", low=3, high=63, odd=True)
    tau: int = number(25, "half of the initial search window W_tau, hence 50 x 50", unit="px", low=1, high=200)
    band: float = number(3.0, "distance to the epipolar line (epsilon of 3.3.2)", unit="px of the pyramid level")
    min_contrast: float = number(2.0, "standard deviation under which a template has no texture", unit="grey levels")
