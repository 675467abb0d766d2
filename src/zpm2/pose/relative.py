"""The relative pose of a matched pair, on one screen (paper 3.5.1): points in regions, regions checked, E, R and t."""

import dataclasses
from collections.abc import Sequence
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import Config
from zpm2.errors import Failed
from zpm2.features import PointMatcher
from zpm2.global_match import initial_geometry
from zpm2.global_match.chance import MIRRORED, log_chance
from zpm2.model import Camera, Image, PointMatches, PolygonArrays
from zpm2.pose import crops, degeneracy
from zpm2.pose.estimators import Motion, PoseEstimator, open_estimator
from zpm2.pose.focal import focal_from_points
from zpm2.pose.points import Correspondences, cell_of, region_of, spread, union
from zpm2.pose.refine import Refined, blocks, refine
from zpm2.pose.result import Pose, PoseResult
from zpm2.result import MatchResult
from zpm2.stereo.intrinsics import centred

Array = NDArray[np.float64]
CELLS = 8  # along each side of the left image: the places of points without a region, and the buckets of `spread`
JUDGED = 5  # points from which a region is judged as a whole
REACH = 5.0  # thresholds, within which points take part in the refinement
BLOCKS = 3  # along each side of the left image, that errors of the pose are told from
AGREE = 0.3  # share of a region's points that must agree with the pose


class PoseFinder:
    """Relative poses of matched pairs. Opens its estimator and its point matcher once.

        result = zpm2.match("left.png", "right.png")
        pose = PoseFinder(zpm2.preset("default"))(result, cameras)

    `config` is that of the run. `matcher` finds points in crops; the configured one is loaded where none is given and
    `pose.crops` asks for it.
    """

    def __init__(self, config: Config, matcher: PointMatcher | None = None, device: str = "cpu") -> None:
        self.config, self.device, self._matcher = config, device, matcher
        self.estimator: PoseEstimator = open_estimator(config.pose.estimator)

    def __call__(
        self, result: MatchResult, cameras: tuple[Camera, Camera] | None, images: tuple[Image, Image] | None = None
    ) -> PoseResult:
        """The pose of the right camera seen from the left one, X_right = R X_left + s t.

        `cameras` None: nothing is known; a focal length is estimated where the epipolar geometry tells one. `images`
        are needed for crops, where the result does not hold them. What cannot be estimated is `Failed` in the result.
        """
        options, seed, seconds, warnings = self.config.pose, self.config.seed, {}, list[str]()
        start = perf_counter()
        chosen = self.gather(result, images, warnings)
        seconds["points"] = perf_counter() - start
        start = perf_counter()
        found: tuple[Camera, Camera] | Failed = cameras or self._estimated_cameras(result)
        pose: Pose | Failed
        inliers, rejected = np.zeros(len(chosen), bool), np.zeros(0, np.intp)
        if initial_geometry(result.points, self.config.global_match, seed).mirrored:
            pose = Failed(f"{MIRRORED}: mirror it back")
        elif isinstance(found, Failed):
            pose = Failed(f"the cameras are not known: {found}; give K, or K guess")
        else:
            pose, inliers, rejected = self.estimate(chosen, found)
            if not isinstance(pose, Failed):
                pose = self._proven(pose, result.points, found, self._threshold(found))
        seconds["pose"] = perf_counter() - start
        if options.estimator == "auto" and self.estimator.name == "opencv":
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
            config=dataclasses.asdict(options) | {"estimator": self.estimator.name, "seed": seed},
            timings=seconds,
            warnings=warnings,
        )

    def gather(
        self, result: MatchResult, images: tuple[Image, Image] | None = None, warnings: list[str] | None = None
    ) -> Correspondences:
        """C: the points of the whole images, filtered by regions if so configured, and those of crops.

        `warnings` gets a sentence where that is not what was asked for.
        """
        options, pairs = self.config.pose, [PolygonArrays(side) for side in result.matched_polygons()]
        region = region_of(result.points, pairs[0], pairs[1])
        points = Correspondences(result.points, region, np.zeros(len(region), bool))
        if options.points == "regions":
            points = points[region >= 0]
        if options.crops != "off" and len(result.matches):
            points = union(points, self._local(result, pairs, images or result.images()))
        if options.bucket:
            points = points[spread(points.points, (result.left.width, result.left.height), CELLS, options.bucket)]
        if options.points == "regions" and len(points) == 0 and len(result.points):
            (warnings if warnings is not None else []).append("no point lies in matched regions: all points are used")
            points = Correspondences(result.points, region, np.zeros(len(region), bool))
        return points

    def _local(
        self, result: MatchResult, pairs: Sequence[PolygonArrays], images: tuple[Image, Image]
    ) -> Correspondences:
        """M2: the points of crops that lie in a matched pair."""
        options, side = self.config.pose, self.config.pose.crop_size
        if options.crops == "boxes":
            chosen = crops.boxes(pairs[0], pairs[1], side)
        else:
            confidence = np.array([match.confidence for match in result.matches])
            zoom = min(1.0, self.config.points.max_size / max(images[0].width, images[0].height))
            maps = result.maps()
            chosen = crops.rectified(pairs[0], pairs[1], maps, confidence, side, zoom, options.max_crops)
        points = crops.match(chosen, images, self._load(), side)
        region = region_of(points, pairs[0], pairs[1])
        return Correspondences(points, region, np.ones(len(region), bool))[region >= 0]

    def _load(self) -> PointMatcher:
        if self._matcher is None:
            from zpm2 import features

            points = dataclasses.replace(self.config.points, max_keypoints=self.config.pose.crop_points)
            self._matcher = features.create(dataclasses.replace(points, rotated_retry=False), self.device)
        return self._matcher

    def estimate(
        self, chosen: Correspondences, cameras: tuple[Camera, Camera], seed: int | None = None
    ) -> tuple[Pose | Failed, NDArray[np.bool_], NDArray[np.intp]]:
        """The pose, the (n,) inliers, and the regions (rows of matched pairs) that were rejected."""
        seed = self.config.seed if seed is None else seed
        threshold = self._threshold(cameras)
        sides = chosen.points.left, chosen.points.right
        left, right = (camera.rays(points) for camera, points in zip(cameras, sides, strict=True))

        def estimate(rows: NDArray[np.intp]) -> Motion | Failed:
            motion = self.estimator.estimate(left[rows], right[rows], threshold, seed)
            if isinstance(motion, Failed):
                return motion
            inliers = np.zeros(len(left), bool)
            inliers[rows] = motion.inliers
            return dataclasses.replace(motion, inliers=inliers)

        motion = estimate(np.arange(len(left)))
        rejected = np.zeros(0, np.intp)
        if isinstance(motion, Failed):
            return motion, np.zeros(len(left), bool), rejected
        rejected = inconsistent_regions(motion, left, right, chosen.region, threshold)
        if len(rejected):
            again = estimate(np.flatnonzero(~np.isin(chosen.region, rejected)))
            if isinstance(again, Failed):
                rejected = rejected[:0]
            else:
                motion = again
        refined = self._refined(motion, left, right, ~np.isin(chosen.region, rejected), threshold)
        refined = _with_inliers(refined, left, right, chosen, rejected, threshold)
        places = places_of(chosen, cameras[0].size)
        seen = degeneracy.examine(refined.motion, left, right, places, refined.translation_sigma, threshold, seed)
        seen = seen.beside(self._rival(refined.motion, left, right, threshold, seed), int(refined.motion.inliers.sum()))
        inliers = refined.motion.inliers if seen.turned is None else seen.turned
        return Pose.of(refined, seen), inliers, rejected

    def _refined(
        self, motion: Motion, left: Array, right: Array, usable: NDArray[np.bool_], threshold: float
    ) -> Refined:
        """Refined on the `usable` points that are anywhere near, and once more on those near the refined pose."""
        parts = blocks(left, BLOCKS)
        for _ in range(2):
            near = geometry.sampson_distance(motion.essential, left, right) <= REACH * threshold
            refined = refine(dataclasses.replace(motion, inliers=near & usable), left, right, parts, threshold)
            motion = refined.motion
        return dataclasses.replace(refined, covariance=self.config.pose.inflation**2 * refined.covariance)

    def _proven(
        self, pose: Pose, points: PointMatches, cameras: tuple[Camera, Camera], threshold: float
    ) -> Pose | Failed:
        """`pose`, if more of the points of the whole images agree on it than on poses of unrelated photographs.

        Points of crops prove nothing: they were looked for where the matches put them.
        """
        focal = float(np.sqrt(cameras[0].focal * cameras[1].focal))
        left, right = (camera.rays(side) for camera, side in zip(cameras, (points.left, points.right), strict=True))
        across = np.array([1.0, 0.0, 0.0]) if pose.translation is None else pose.translation  # a turn fits any t
        essential = geometry.cross_matrix(across) @ pose.rotation
        agree = geometry.sampson_distance(essential, left, right) <= degeneracy.NOISE * threshold
        unit = np.diag([1 / focal, 1 / focal, 1.0])
        flat = PointMatches(left * focal, right * focal, points.score)
        limits = self.config.global_match.chance
        chance = log_chance(unit @ essential @ unit, flat, agree, sample=5, models=10, config=limits)
        if chance <= -limits.significance:
            return pose
        return Failed(
            f"the photographs may not show the same scene: {int(agree.sum())} of {len(points)} homologous points agree "
            "on the best pose, which may be chance"
        )

    def _rival(self, motion: Motion, left: Array, right: Array, threshold: float, seed: int) -> int:
        """How many of the points that are far from agreeing with `motion` agree on another pose."""
        far = geometry.sampson_distance(motion.essential, left, right) > 2 * degeneracy.NOISE * threshold
        other = self.estimator.estimate(left[far], right[far], threshold, seed)
        if isinstance(other, Failed):
            return 0
        distance = geometry.sampson_distance(other.essential, left[far], right[far])
        return int((distance <= degeneracy.NOISE * threshold).sum())

    def _threshold(self, cameras: tuple[Camera, Camera]) -> float:
        """The noise of a point in units of rays. It grows with the px of the image per px of the frame that the point
        was found in."""
        longest = max(max(camera.size) for camera in cameras)
        noise = self.config.pose.noise_px * max(1.0, longest / self.config.points.max_size)
        return noise / float(np.sqrt(cameras[0].focal * cameras[1].focal))

    def _estimated_cameras(self, result: MatchResult) -> tuple[Camera, Camera] | Failed:
        """Both cameras with the focal length that the points tell."""
        if isinstance(result.fundamental, Failed):
            return result.fundamental
        sizes = (result.left.width, result.left.height), (result.right.width, result.right.height)
        near = geometry.epipolar_inliers(
            result.fundamental, result.points.left, result.points.right, self.config.global_match.epipolar_px
        )
        focal = focal_from_points(result.points[near], sizes, self.config.seed)
        if isinstance(focal, Failed):
            return focal
        return centred(focal[0], sizes[0], "estimated"), centred(focal[0], sizes[1], "estimated")


def inconsistent_regions(
    motion: Motion, left: Array, right: Array, region: NDArray[np.intp], threshold: float
) -> NDArray[np.intp]:
    """Regions of which most points disagree with the motion (Sampson distance): they are not the same region, or it
    moved. Judged as a whole, from `JUDGED` points on."""
    agree = geometry.sampson_distance(motion.essential, left, right) <= degeneracy.NOISE * threshold
    inside = region >= 0
    count = np.bincount(region[inside], minlength=1)
    good = np.bincount(region[inside], weights=agree[inside], minlength=1)
    return np.flatnonzero((count >= JUDGED) & (good < AGREE * count))


def places_of(points: Correspondences, size: tuple[int, int]) -> NDArray[np.intp]:
    """(n,) the region of each point; for one without, its cell of the left image, below 0."""
    return np.where(points.region >= 0, points.region, -1 - cell_of(points.points, size, CELLS))


def _with_inliers(
    refined: Refined,
    left: Array,
    right: Array,
    chosen: Correspondences,
    rejected: NDArray[np.intp],
    threshold: float,
) -> Refined:
    """With the inliers of the refined pose: near their epipolar lines, before both cameras, in no rejected region."""
    motion = refined.motion
    inliers = geometry.sampson_distance(motion.essential, left, right) <= degeneracy.NOISE * threshold
    inliers &= geometry.in_front(motion.rotation, motion.translation, left, right)
    inliers &= ~np.isin(chosen.region, rejected)
    return dataclasses.replace(refined, motion=dataclasses.replace(motion, inliers=inliers))
