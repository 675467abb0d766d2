"""Where each polygon should be in the other image, coarsely (paper 3.3)."""

from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import number, option, share
from zpm2.config.robust import MagsacConfig


@dataclass(frozen=True)
class ChanceConfig:
    """When points agree on a geometry by more than chance, and when an image is mirrored (docs/confidence.md)."""

    significance: float = number(
        8.0,
        "a geometry is evidence if at most 10 to the power of minus this many as good ones are expected by chance",
        unit="decades",
        source="measured on unrelated pairs",
    )
    scene_width: float = number(
        2.0,
        "around `significance`, in which the probability of one scene rises by a factor of 10 in its odds",
        unit="decades",
        above=True,
        source="measured: two scenes reach -3.3, one scene -27.9; each is far on its side (docs/confidence.md)",
    )
    unsupported: float = share(
        0.03,
        "probability of one scene where points agree no better than by chance",
        source="measured: of 64 such pairs 1 shows one scene, hence (1 + 1) / (64 + 2)",
    )
    independent_distance: float = number(
        16.0,
        "points closer in both images count once: they see the same texture",
        unit="px",
        source="twice the cell of 8 px that networks read descriptors from",
    )
    max_points: int = number(
        20_000, "that are thinned to independent ones, evenly taken from more", low=1, source="time; more say the same"
    )
    max_compared: int = number(
        500,
        "independent points that are compared each with each other",
        low=2,
        high=10_000,
        source="time grows with the square",
    )
    min_mirror_points: int = number(
        10,
        "independent points from which an image may be called mirrored",
        low=4,
        source="with fewer, half of them turned over may be chance",
    )
    min_mirrored: float = share(
        0.5,
        "of the points must be turned over for that, or more",
        source="most of them; matchers find small pieces that are not turned over themselves",
    )


@dataclass(frozen=True)
class GlobalConfig:
    """Initial geometry and bidirectional pyramid (paper 3.3, Algorithm 1)."""

    epipolar_px: float = number(
        3.0,
        'MAGSAC++ threshold of F and the "sufficiently close" of 3.3.1',
        unit="px",
        source="the noise of learned points is 1 to 2 px, docs/points.md",
    )
    homography_px: float = number(
        6.0, "MAGSAC++ threshold of H", unit="px", source="twice epipolar_px: relief moves points off a plane"
    )
    search: Literal["pyramid", "fixed"] = option(
        "pyramid", "fixed: a window as wide as the polygon's shorter side (4.4.1)"
    )
    factor: int = number(3, "pyramid downsampling factor", low=2, high=10, source="paper 4.1.3")
    top_size: int = number(
        200,
        "downsampling stops when a side of the top level is no longer than this",
        unit="px",
        low=1,
        source="paper 4.1.3",
    )
    max_layers: int = number(
        10,
        "of the pyramid, full resolution included",
        low=1,
        high=100,
        source="never reached: 200 px times 3 to the power of 9",
    )
    phi: int = number(15, "template window W_phi, odd", unit="px", low=3, high=63, odd=True, source="paper 4.1.3")
    tau: int = number(
        25, "half of the initial search window W_tau, hence 50 x 50", unit="px", low=1, high=200, source="paper 4.1.3"
    )
    band: float = number(
        3.0,
        "distance to the epipolar line (epsilon of 3.3.2)",
        unit="px of the pyramid level",
        source="not printed in the paper; as epipolar_px",
    )
    min_contrast: float = number(
        2.0, "standard deviation under which a template has no texture", unit="grey levels", source="a camera's noise"
    )
    magsac: MagsacConfig = field(default_factory=MagsacConfig)
    chance: ChanceConfig = field(default_factory=ChanceConfig)
