"""Relative pose from matched polygons (paper 3.5.1)."""

from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import number, option, share
from zpm2.config.robust import MagsacConfig


@dataclass(frozen=True)
class DegeneracyConfig:
    """What makes a pose doubtful (`pose.flags`)."""

    explained: float = share(
        0.95,
        "inliers that a turn or a plane explains, from which on it explains all of them",
        source="one inlier in twenty may be wrong",
    )
    min_inliers: int = number(20, "below, a pose may be chance", source="four times the five points that fit any pose")
    min_inlier_share: float = share(
        0.15, "the same, of the points", source="measured: of random points at most 4 % agree on a pose"
    )
    min_regions: int = number(3, "matched regions that the inliers must lie in", source="two may lie on one plane")
    rotation_rounds: int = number(
        20,
        "of reweighting, by which the turn is found",
        low=1,
        high=1000,
        source="measured: 10 settle it to 0.00002 degrees where half of the points are wrong",
    )
    rival_distance: float = number(
        2.0,
        "from a pose, beyond which points may belong to another one",
        unit="times pose.inlier",
        source="points at the limit belong to this pose",
    )
    rival: float = number(
        0.5, "points of another pose, times the inliers, that make a pose ambiguous", source="docs/pose.md"
    )
    max_direction_sigma: float = number(
        15.0,
        "of the direction of translation; beyond, it is not known",
        unit="degrees",
        high=180.0,
        source="three of it are half of a right angle",
    )
    same_rotation: float = number(
        1.0,
        "rotations of a plane that differ less are one",
        unit="degrees",
        high=180.0,
        source="the accuracy of a pose, docs/pose.md",
    )
    same_direction: float = share(
        0.9998, "cosine of directions of translation from which on they are one", source="about a degree"
    )


@dataclass(frozen=True)
class FocalConfig:
    """A focal length from the epipolar geometry alone (Bougnoux, ICCV 1998)."""

    min_points: int = number(50, "inliers of the fundamental matrix", low=8)
    samples: int = number(
        30,
        "bootstrap samples of the inliers",
        low=1,
        high=10_000,
        source="five fall outside of the middle two thirds on either side",
    )
    min_solved: float = share(
        0.8, "samples that must have a solution", source="with many impossible samples the others are chance"
    )
    max_spread: float = number(0.25, "half of the range of the middle two thirds of the samples, times their median")
    low: float = number(
        0.3,
        "shortest focal length that cameras have",
        unit="longer side",
        source="a fisheye lens; a field of view of 118 degrees",
    )
    high: float = number(6.0, "longest", unit="longer side", source="a telephoto lens; a field of view of 10 degrees")


@dataclass(frozen=True)
class PoseConfig:
    """Relative pose from matched polygons (paper 3.5.1)."""

    estimator: Literal["opencv", "poselib", "auto"] = option(
        "opencv", "MAGSAC++; LO-RANSAC; auto: poselib if it is there", source="docs/pose.md"
    )
    noise_px: float = number(
        1.0,
        "threshold of the estimator; more where images were reduced to points.max_size",
        unit="px",
        above=True,
        source="the noise of learned points, docs/points.md",
    )
    min_points: int = number(
        8, "homologous points, and inliers, of a pose", low=6, source="any five fit one exactly; three more must agree"
    )
    magsac: MagsacConfig = field(default_factory=MagsacConfig)
    poselib_min_iterations: int = number(1000, "samples of LO-RANSAC at least", high=1_000_000, source="PoseLib's own")
    poselib_max_iterations: int = number(
        20_000, "samples of LO-RANSAC at most", low=1, high=1_000_000, source="PoseLib: 100,000"
    )
    starts: int = number(
        1,
        "of an estimator, where few points agree: further ones of MAGSAC++; the most likely pose counts",
        low=1,
        high=1000,
        source="beyond the paper; 10 in preset default, docs/pose.md",
    )
    sure_inliers: float = share(
        0.35,
        "of the points of the whole images; where as many agree on a pose, one start is enough",
        source="measured: 0.2 to 0.3 on pairs whose seeds differ, 0.4 and more on others, docs/pose.md",
    )
    tail: float = number(
        1.5,
        "scale of the Cauchy distribution by which poses are compared",
        unit="noise_px",
        above=True,
        source="measured: 1 to 3 give the same, docs/pose.md",
    )
    points: Literal["regions", "all"] = option(
        "regions", "of the whole images: those in matched regions (M1 filtered), or all", source="paper 3.5.1"
    )
    crops: Literal["boxes", "rectified", "off"] = option(
        "boxes",
        "M2: boxes of both polygons, or the right one as the left",
        source="paper 3.5.1; rectified: docs/pose.md",
    )
    crop_size: int = number(
        480,
        "side of a crop",
        unit="px",
        low=32,
        high=4096,
        source="a region of 120 px at crop_max_zoom; time grows with the area",
    )
    crop_points: int = number(512, "per crop", low=1, high=100_000, source="one for every 21 x 21 px of a crop")
    max_crops: int = number(
        40, "of rectified crops, the most confident matches first", low=1, high=10_000, source="time grows with them"
    )
    crop_margin: float = number(
        0.15,
        "added to a box on every side, times its longer side",
        source="corners at the outline need their surroundings",
    )
    crop_max_zoom: float = number(
        4.0,
        "crop px per image px; beyond, there is nothing more to see",
        above=True,
        source="interpolated px hold nothing new",
    )
    crop_min_zoom: float = number(
        1.2,
        "rectified crops: times the scale at which the whole image was searched",
        source="else it shows what was seen before",
    )
    crop_min_box: float = number(
        12.0, "shorter side of a box that is worth a crop", unit="px", source="smaller ones have no corners"
    )
    crop_max_iou: float = share(
        0.7,
        "rectified crops: of left boxes; beyond, one crop shows the other's polygon too",
        source="one crop shows most of the other",
    )
    crop_sharpness: float = number(
        0.25,
        "of a level of an image's pyramid, by which a crop is read from the next smaller one too early",
        high=1.0,
        source="a little blur is better than a little aliasing",
    )
    crop_max_stretch: float = number(
        16.0,
        "rectified crops: ratio of the areas of a px in two corners, beyond which a map shows no surface",
        source="a plane seen at so small an angle has no texture left",
    )
    same_point: float = number(
        2.0, "two points that are closer in both images are one", unit="px", source="the noise of a point in both"
    )
    bucket: int = number(
        0,
        "points kept in each cell of the left image, best first; 0: all",
        source="beyond the paper; 50 in preset default, docs/pose.md",
    )
    cells: int = number(
        8,
        "along each side of the left image: for `bucket`, and to count the places of points",
        low=1,
        high=1000,
        source="64 places, each an eighth of a side",
    )
    inlier: float = number(
        2.0, "Sampson distance of a point that agrees with a pose", unit="noise_px", source="95 % of normal noise"
    )
    min_region_points: int = number(
        5, "points from which on a matched region is judged as a whole", low=1, source="two of five may be wrong"
    )
    min_region_agreement: float = share(
        0.3, "points of a region that must agree with the pose", source="wrong matches have nearly none, true ones most"
    )
    refine_reach: float = number(
        5.0,
        "Sampson distance of points that take part in the refinement",
        unit="noise_px",
        above=True,
        source="farther ones have no weight",
    )
    refine_rounds: int = number(
        2,
        "refinements: each on the points near the pose that the one before found",
        low=1,
        high=100,
        source="the second one takes in points that the first estimate missed",
    )
    refine_steps: int = number(
        30,
        "Newton steps of the refinement, at most",
        low=1,
        high=10_000,
        source="ends after some, when a step is below 1e-9",
    )
    jackknife_blocks: int = number(
        3,
        "along each side of the left image: the groups left out one by one for the covariance",
        low=1,
        high=100,
        source="nine groups: as large as they can be while there are enough to compare",
    )
    inflation: float = number(
        1.8, "of standard deviations", above=True, source="measured on pairs with known poses, docs/pose.md"
    )
    degeneracy: DegeneracyConfig = field(default_factory=DegeneracyConfig)
    focal: FocalConfig = field(default_factory=FocalConfig)
