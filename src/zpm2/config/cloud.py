"""Polygons lifted onto a surface (paper 3.5.2)."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class CloudConfig:
    """Polygons lifted onto a surface (paper 3.5.2). The paper prints none of these numbers."""

    diffusion: Literal["scale", "surface"] = option("scale", "one scale for all of it, or its part on one surface")
    step: float = number(2.0, "delta: samples of a boundary are no farther apart", unit="px", above=True)
    min_scale: float = share(
        0.4, "s_min: a polygon that must shrink further, to less than its square of area, is rejected", above=True
    )
    halvings: int = number(6, "of the interval of scales, from s_min to 1", high=60)
    max_edge: float = number(
        6.0, "tau, a longer edge between samples, per px, leads to another surface", unit="medians"
    )
    max_fold: float = number(
        100.0, "between normals of neighbouring samples, beyond which the surface is folded", unit="degrees"
    )
    max_size: float = number(
        20.0, "times the size that it would have facing the camera; roads are seen at a small angle"
    )
    min_overlap: float = share(0.5, "IoU of a lifted polygon, seen from the other camera, with its partner there")
    max_distance: float = number(0.25, "distance between the boundaries that both views lift", unit="sqrt(area)")
    fill: float = number(0.02, "of the mesh's extent: holes up to this wide are filled")
    neighbors: int = number(2, "views that each view is matched with", low=1, high=10_000)
    same: float = share(0.75, "IoU from which on two regions of an image, or two patches, are one")
