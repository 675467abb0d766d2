"""Relative pose from matched polygons (paper 3.5.1)."""

from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import number, option, share
from zpm2.config.robust import MagsacConfig


@dataclass(frozen=True)
class DegeneracyConfig:
    """What makes a pose doubtful (`pose.flags`)."""

    explained: float = share(0.95, "inliers that a turn or a plane explains, from which on it explains all of them")
    min_inliers: int = number(20, "below, a pose may be chance")
    min_inlier_share: float = share(0.15, "the same, of the points")
    min_regions: int = number(3, "matched regions that the inliers must lie in")
    rotation_rounds: int = number(20, "of reweighting, by which the turn is found", low=1, high=1000)
    rival_distance: float = number(
        2.0, "from a pose, beyond which points may belong to another one", unit="times pose.inlier"
    )
    rival: float = number(0.5, "points of another pose, times the inliers, that make a pose ambiguous")
    max_direction_sigma: float = number(
        15.0, "of the direction of translation; beyond, it is not known", unit="degrees", high=180.0
    )
    same_rotation: float = number(1.0, "rotations of a plane that differ less are one", unit="degrees", high=180.0)
    same_direction: float = share(0.9998, "cosine of directions of translation from which on they are one")


@dataclass(frozen=True)
class FocalConfig:
    """A focal length from the epipolar geometry alone (Bougnoux, ICCV 1998)."""

    min_points: int = number(50, "inliers of the fundamental matrix", low=8)
    samples: int = number(30, "bootstrap samples of the inliers", low=1, high=10_000)
    min_solved: float = share(0.8, "samples that must have a solution")
    max_spread: float = number(0.25, "half of the range of the middle two thirds of the samples, times their median")
    low: float = number(0.3, "shortest focal length that cameras have", unit="longer side")
    high: float = number(6.0, "longest", unit="longer side")


@dataclass(frozen=True)
class PoseConfig:
    """Relative pose from matched polygons (paper 3.5.1)."""

    estimator: Literal["opencv", "poselib", "auto"] = option(
        "opencv", "MAGSAC++; LO-RANSAC; auto: poselib if it is there"
    )
    noise_px: float = number(
        1.0, "threshold of the estimator; more where images were reduced to points.max_size", unit="px", above=True
    )
    min_points: int = number(
        8, "homologous points, and inliers, of a pose", low=6, source="any five fit one exactly; three more must agree"
    )
    magsac: MagsacConfig = field(default_factory=MagsacConfig)
    poselib_min_iterations: int = number(1000, "samples of LO-RANSAC at least", high=1_000_000, source="PoseLib's own")
    poselib_max_iterations: int = number(
        20_000, "samples of LO-RANSAC at most", low=1, high=1_000_000, source="PoseLib: 100,000"
    )
    points: Literal["regions", "all"] = option(
        "regions", "of the whole images: those in matched regions (M1 filtered), or all"
    )
    crops: Literal["boxes", "rectified", "off"] = option(
        "boxes", "M2: boxes of both polygons, or the right one as the left"
    )
    crop_size: int = number(480, "side of a crop", unit="px", low=32, high=4096)
    crop_points: int = number(512, "per crop", low=1, high=100_000)
    max_crops: int = number(40, "of rectified crops, the most confident matches first", low=1, high=10_000)
    crop_margin: float = number(0.15, "added to a box on every side, times its longer side")
    crop_max_zoom: float = number(4.0, "crop px per image px; beyond, there is nothing more to see", above=True)
    crop_min_zoom: float = number(1.2, "rectified crops: times the scale at which the whole image was searched")
    crop_min_box: float = number(12.0, "shorter side of a box that is worth a crop", unit="px")
    crop_max_iou: float = share(0.7, "rectified crops: of left boxes; beyond, one crop shows the other's polygon too")
    crop_sharpness: float = number(
        0.25, "of a level of an image's pyramid, by which a crop is read from the next smaller one too early", high=1.0
    )
    crop_max_stretch: float = number(
        16.0, "rectified crops: ratio of the areas of a px in two corners, beyond which a map shows no surface"
    )
    same_point: float = number(2.0, "two points that are closer in both images are one", unit="px")
    bucket: int = number(0, "points kept in each cell of the left image, best first; 0: all")
    cells: int = number(
        8, "along each side of the left image: for `bucket`, and to count the places of points", low=1, high=1000
    )
    inlier: float = number(2.0, "Sampson distance of a point that agrees with a pose", unit="noise_px")
    min_region_points: int = number(5, "points from which on a matched region is judged as a whole", low=1)
    min_region_agreement: float = share(0.3, "points of a region that must agree with the pose")
    refine_reach: float = number(
        5.0, "Sampson distance of points that take part in the refinement", unit="noise_px", above=True
    )
    refine_rounds: int = number(
        2, "refinements: each on the points near the pose that the one before found", low=1, high=100
    )
    refine_steps: int = number(30, "Newton steps of the refinement, at most", low=1, high=10_000)
    jackknife_blocks: int = number(
        3, "along each side of the left image: the groups left out one by one for the covariance", low=1, high=100
    )
    inflation: float = number(
        1.8, "of standard deviations", above=True, source="measured on pairs with known poses, docs/pose.md"
    )
    degeneracy: DegeneracyConfig = field(default_factory=DegeneracyConfig)
    focal: FocalConfig = field(default_factory=FocalConfig)
