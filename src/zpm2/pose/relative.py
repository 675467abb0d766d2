"""The relative pose of a matched pair, on one screen (paper 3.5.1): points in regions, regions checked, E, R and t."""

import dataclasses
from collections.abc import Sequence
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import Config, PoseConfig
from zpm2.errors import Failed
from zpm2.features import PointMatcher, seen_size
from zpm2.global_match import initial_geometry
from zpm2.global_match.chance import MIRRORED, log_chance
from zpm2.model import Camera, Image, PointMatches, PolygonArrays
from zpm2.pose import crops, degeneracy
from zpm2.pose.estimators import OpenCv, PoseEstimate, PoseEstimator, among, most_likely, open_estimator
from zpm2.pose.focal import focal_from_points
from zpm2.pose.points import Correspondences, RayPairs, cell_of, region_of, spread, union
from zpm2.pose.refine import RefinedPose, blocks, refine
from zpm2.pose.result import PoseResult, RelativePose
from zpm2.result import MatchResult
from zpm2.stereo.intrinsics import centred

Array = NDArray[np.float64]
ESSENTIAL_SAMPLE, ESSENTIAL_MODELS = 5, 10  # points that an essential matrix follows from, and how many do


class PoseFinder:
    """Relative poses of matched pairs. Opens its estimator and its point matcher once.

        result = zpm2.match("left.png", "right.png")
        pose = PoseFinder(zpm2.preset("default"))(result, cameras)

    `config` is that of the run. `matcher` finds points in crops; the configured one is loaded where none is given and
    `pose.crops` asks for it.
    """

    def __init__(self, config: Config, matcher: PointMatcher | None = None, device: str = "cpu") -> None:
        self.config, self.device, self._matcher = config, device, matcher
        self.estimator: PoseEstimator = open_estimator(config.pose.estimator, config.pose)
        self.further = OpenCv(config.pose)

    def __call__(
        self, result: MatchResult, cameras: tuple[Camera, Camera] | None, images: tuple[Image, Image] | None = None
    ) -> PoseResult:
        """The pose of the right camera seen from the left one, X_right = R X_left + s t.

        `cameras` None: they are not known; a focal length is estimated where the epipolar geometry determines one.
        `images` are needed for crops, where the result does not hold them. What cannot be estimated is `Failed` in the
        result.
        """
        config, seed, seconds, warnings = self.config.pose, self.config.seed, {}, list[str]()
        start = perf_counter()
        chosen = self.gather(result, images, warnings)
        seconds["points"] = perf_counter() - start
        start = perf_counter()
        found: tuple[Camera, Camera] | Failed = cameras or self._estimated_cameras(result)
        pose: RelativePose | Failed
        inliers, rejected = np.zeros(len(chosen), bool), np.zeros(0, np.intp)
        if initial_geometry(result.points, self.config.global_match, seed).mirrored:
            pose = Failed(f"{MIRRORED}: mirror it back")
        elif isinstance(found, Failed):
            pose = Failed(f"the cameras are not known: {found}; give K, or K guess")
        else:
            pose, inliers, rejected = self.estimate(chosen, found)
            if not isinstance(pose, Failed):
                pose = self._beyond_chance(pose, result.points, found)
        seconds["pose"] = perf_counter() - start
        if config.estimator == "auto" and self.estimator.name == "opencv":
            warnings.append("poselib is not installed, OpenCV estimates the pose, less exactly: pip install poselib")
        ids = [(m.left, m.right) for m in result.matches]
        return PoseResult(
            cameras=found,
            pose=pose,
            points=chosen,
            inliers=inliers,
            regions=ids,
            rejected=[ids[row] for row in rejected],
            found=len(result.points),
            fundamental=result.fundamental,
            homography=result.homography,
            config=dataclasses.asdict(config) | {"estimator": self.estimator.name, "seed": seed},
            timings=seconds,
            warnings=warnings,
        )

    def gather(
        self, result: MatchResult, images: tuple[Image, Image] | None = None, warnings: list[str] | None = None
    ) -> Correspondences:
        """C: the points of the whole images, filtered by regions if so configured, and those of crops.

        If filtering leaves no point, all points are used and `warnings` receives a sentence that says so.
        """
        config, pairs = self.config.pose, [PolygonArrays(side) for side in result.matched_polygons()]
        region = region_of(result.points, pairs[0], pairs[1])
        points = Correspondences(result.points, region, np.zeros(len(region), bool))
        if config.points == "regions":
            points = points[region >= 0]
        if config.crops != "off" and len(result.matches):
            points = union(points, self._local(result, pairs, images or result.images()), config.same_point)
        if config.bucket:
            size = result.left.width, result.left.height
            points = points[spread(points.points, size, config.cells, config.bucket)]
        if config.points == "regions" and len(points) == 0 and len(result.points):
            (warnings if warnings is not None else []).append("no point lies in matched regions: all points are used")
            points = Correspondences(result.points, region, np.zeros(len(region), bool))
        return points

    def _local(
        self, result: MatchResult, pairs: Sequence[PolygonArrays], images: tuple[Image, Image]
    ) -> Correspondences:
        """M2: the points of crops that lie in a matched pair."""
        config = self.config.pose
        if config.crops == "boxes":
            chosen = crops.boxes(pairs[0], pairs[1], config)
        else:
            confidence = np.array([match.confidence for match in result.matches])
            zoom = min(1.0, seen_size(self.config.points) / max(images[0].width, images[0].height))
            chosen = crops.rectified(pairs[0], pairs[1], result.maps(), confidence, zoom, config)
        points = crops.match(chosen, images, self._load(), config)
        region = region_of(points, pairs[0], pairs[1])
        return Correspondences(points, region, np.ones(len(region), bool))[region >= 0]

    def _load(self) -> PointMatcher:
        if self._matcher is None:
            from zpm2 import features

            points = dataclasses.replace(self.config.points, max_keypoints=self.config.pose.crop_points)
            self._matcher = features.create(points, self.device)
        return self._matcher

    def estimate(
        self, chosen: Correspondences, cameras: tuple[Camera, Camera], seed: int | None = None
    ) -> tuple[RelativePose | Failed, NDArray[np.bool_], NDArray[np.intp]]:
        """The pose, the (n,) inliers, and the regions (rows of matched pairs) that were rejected."""
        seed = self.config.seed if seed is None else seed
        config, rays = self.config.pose, self._rays(chosen.points, cameras)

        def estimate(rows: NDArray[np.intp]) -> PoseEstimate | Failed:
            found = most_likely(self.estimator, self.further, rays[rows], ~chosen.local[rows], seed, config)
            return among(found, rows, len(rays))

        first = estimate(np.arange(len(rays)))
        rejected = np.zeros(0, np.intp)
        if isinstance(first, Failed):
            return first, np.zeros(len(rays), bool), rejected
        rejected = inconsistent_regions(first, rays, chosen.region, config)
        if len(rejected):
            second = estimate(np.flatnonzero(~np.isin(chosen.region, rejected)))
            if isinstance(second, Failed):
                rejected = rejected[:0]
            else:
                first = second
        usable = ~np.isin(chosen.region, rejected)
        refined = _with_inliers(self._refined(first, rays, usable), rays, usable, config)
        final = refined.estimate
        places = places_of(chosen, cameras[0].size, config.cells)
        doubts = degeneracy.examine(final, rays, places, refined.translation_sigma, config, seed)
        doubts = doubts.with_rival(self._rival(final, rays, seed), int(final.inliers.sum()), config.degeneracy)
        inliers = final.inliers if doubts.rotated is None else doubts.rotated
        return RelativePose.of(refined, doubts), inliers, rejected

    def _refined(self, estimate: PoseEstimate, rays: RayPairs, usable: NDArray[np.bool_]) -> RefinedPose:
        """The pose refined on the `usable` points roughly near it, and again on those near the refined pose."""
        config = self.config.pose
        parts = blocks(rays.left, config.jackknife_blocks)
        for _ in range(config.refine_rounds):
            near = rays.near(estimate.essential, config.refine_reach)
            refined = refine(dataclasses.replace(estimate, inliers=near & usable), rays, parts, config.refine_steps)
            estimate = refined.estimate
        return dataclasses.replace(refined, covariance=config.inflation**2 * refined.covariance)

    def _beyond_chance(
        self, pose: RelativePose, points: PointMatches, cameras: tuple[Camera, Camera]
    ) -> RelativePose | Failed:
        """`pose`, if more of the points of the whole images agree on it than on poses of unrelated photographs.

        Points of crops prove nothing: they were searched for where the matches put them.
        """
        focal = float(np.sqrt(cameras[0].focal * cameras[1].focal))
        rays = self._rays(points, cameras)
        # without a translation any direction will do: a rotation alone satisfies all of them
        direction = np.array([1.0, 0.0, 0.0]) if pose.translation is None else pose.translation
        essential = geometry.cross_matrix(direction) @ pose.rotation
        agree = rays.near(essential, self.config.pose.inlier)
        unit = np.diag([1 / focal, 1 / focal, 1.0])
        pixels = PointMatches(rays.left * focal, rays.right * focal, points.score)
        limits = self.config.global_match.chance
        counts = {"sample": ESSENTIAL_SAMPLE, "models": ESSENTIAL_MODELS}
        if log_chance(unit @ essential @ unit, pixels, agree, **counts, config=limits) <= -limits.significance:
            return pose
        return Failed(
            f"the photographs may not show the same scene: {int(agree.sum())} of {len(points)} homologous points agree "
            "on the best pose, which may be chance"
        )

    def _rival(self, estimate: PoseEstimate, rays: RayPairs, seed: int) -> int:
        """How many of the points that are far from agreeing with a pose agree on another one."""
        inlier, away = self.config.pose.inlier, self.config.pose.degeneracy.rival_distance
        far = rays[rays.distance(estimate.essential) > away * inlier * rays.noise]
        other = self.estimator.estimate(far.left, far.right, far.noise, seed)
        return 0 if isinstance(other, Failed) else int(far.near(other.essential, inlier).sum())

    def _rays(self, points: PointMatches, cameras: tuple[Camera, Camera]) -> RayPairs:
        """Points as rays. Their noise grows with the px of the image per px of the frame that they were found in."""
        longest = max(max(camera.size) for camera in cameras)
        noise = self.config.pose.noise_px * max(1.0, longest / seen_size(self.config.points))
        left, right = (camera.rays(side) for camera, side in zip(cameras, (points.left, points.right), strict=True))
        return RayPairs(left, right, noise / float(np.sqrt(cameras[0].focal * cameras[1].focal)))

    def _estimated_cameras(self, result: MatchResult) -> tuple[Camera, Camera] | Failed:
        """Both cameras with the focal length that follows from the points."""
        if isinstance(result.fundamental, Failed):
            return result.fundamental
        sizes = (result.left.width, result.left.height), (result.right.width, result.right.height)
        near = geometry.epipolar_inliers(
            result.fundamental, result.points.left, result.points.right, self.config.global_match.epipolar_px
        )
        focal = focal_from_points(result.points[near], sizes, self.config.pose.focal, self.config.seed)
        if isinstance(focal, Failed):
            return focal
        return centred(focal[0], sizes[0], "estimated"), centred(focal[0], sizes[1], "estimated")


def inconsistent_regions(
    estimate: PoseEstimate, rays: RayPairs, region: NDArray[np.intp], config: PoseConfig
) -> NDArray[np.intp]:
    """Regions whose points mostly disagree with the pose (Sampson distance): wrong matches, or objects that moved."""
    agree = rays.near(estimate.essential, config.inlier)
    inside = region >= 0
    count = np.bincount(region[inside], minlength=1)
    good = np.bincount(region[inside], weights=agree[inside], minlength=1)
    return np.flatnonzero((count >= config.min_region_points) & (good < config.min_region_agreement * count))


def places_of(points: Correspondences, size: tuple[int, int], cells: int) -> NDArray[np.intp]:
    """(n,) the region of each point; for one without, its cell of the left image, below 0."""
    return np.where(points.region >= 0, points.region, -1 - cell_of(points.points, size, cells))


def _with_inliers(refined: RefinedPose, rays: RayPairs, usable: NDArray[np.bool_], config: PoseConfig) -> RefinedPose:
    """With the inliers of the refined pose: `usable`, near their epipolar lines, before both cameras."""
    found = refined.estimate
    inliers = rays.near(found.essential, config.inlier) & usable
    inliers &= geometry.in_front(found.rotation, found.translation, rays.left, rays.right)
    return dataclasses.replace(refined, estimate=dataclasses.replace(found, inliers=inliers))
