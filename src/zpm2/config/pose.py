"""Relative pose from matched polygons (paper 3.5.1)."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option


@dataclass(frozen=True)
class PoseConfig:
    """Relative pose from matched polygons (paper 3.5.1)."""

    estimator: Literal["opencv", "poselib", "auto"] = option(
        "opencv", "MAGSAC++; LO-RANSAC; auto: poselib if it is there"
    )
    noise_px: float = number(
        1.0, "threshold of the estimator; more where images were reduced to points.max_size", unit="px", above=True
    )
    points: Literal["regions", "all"] = option(
        "regions", "of the whole images: those in matched regions (M1 filtered), or all"
    )
    crops: Literal["boxes", "rectified", "off"] = option(
        "boxes", "M2: boxes of both polygons, or the right one as the left"
    )
    crop_size: int = number(480, "side of a crop", unit="px", low=32, high=4096)
    crop_points: int = number(512, "per crop", low=1, high=100_000)
    max_crops: int = number(40, "of rectified crops, the surest matches first", low=1, high=10_000)
    inflation: float = number(
        1.8, "of standard deviations", above=True, source="measured on pairs with known poses, docs/pose.md"
    )
    bucket: int = number(0, "points kept in each of 8 x 8 cells of the left image, best first; 0: all")
