"""A relative pose with its covariance, its flags and its points, and `pose.json`."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.errors import Failed, InputError
from zpm2.files.writing import atomic_write, claim
from zpm2.model import Camera
from zpm2.model.brief import brief
from zpm2.pose.degeneracy import Degeneracy
from zpm2.pose.points import Correspondences
from zpm2.pose.refine import RefinedPose
from zpm2.runtime import package_version
from zpm2.stereo.camera_check import doubts

Array = NDArray[np.float64]
SCHEMA = "zpm2-pose/1"
NAME = "pose.json"

FLAG_MEANINGS = {
    "pure_rotation": "the camera only turned: there is no direction of translation",
    "planar_scene": "the scene is one plane: other poses may explain it as well (alternatives)",
    "few_inliers": "few points agree, or a small share of them",
    "few_regions": "fewer than three matched regions hold points that agree",
    "ambiguous": "another pose explains half as many of the other points: repeated texture, or things that moved",
    "uncertain": "the direction of translation is not determined",
}
# with these the true pose may be quite another one
DOUBTFUL_FLAGS = frozenset({"planar_scene", "few_inliers", "few_regions", "ambiguous"})


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The right camera seen from the left one: X_right = R X_left + s t, s > 0 unknown."""

    rotation: Array  # (3, 3)
    translation: Array | None  # (3,) of unit length; None where the camera only turned
    # degrees, one standard deviation; None where `doubtful`, and where the points leave it undetermined
    rotation_sigma: float | None
    translation_sigma: float | None  # degrees, of the direction; the same, and None where there is none
    # (5, 5) rad^2: rotation about the right camera's x, y, z; two angles of the direction of t
    covariance: Array | None
    flags: tuple[str, ...] = ()  # what speaks against it, see `FLAG_MEANINGS`
    alternatives: tuple[tuple[Array, Array], ...] = ()  # R, t that explain a planar scene as well
    starts: int = 1  # of the estimator, of which this is the most likely pose; more than one where few points agree

    __repr__ = brief

    @property
    def sound(self) -> bool:
        """Whether it has no flag."""
        return not self.flags

    @property
    def essential(self) -> Array | None:
        """(3, 3) E = [t]x R: r_right^T E r_left = 0 for rays; None where the camera only turned."""
        if self.translation is None:
            return None
        return geometry.cross_matrix(self.translation) @ self.rotation

    @property
    def doubtful(self) -> bool:
        """Whether the true pose may be quite another one: then no standard deviation holds."""
        return not DOUBTFUL_FLAGS.isdisjoint(self.flags)

    @staticmethod
    def of(refined: RefinedPose, degeneracy: Degeneracy) -> "RelativePose":
        """The refined pose without what its points do not determine."""
        rotation = degeneracy.rotation_only
        holds, covariance = DOUBTFUL_FLAGS.isdisjoint(degeneracy.flags), refined.covariance
        turned, moved = refined.rotation_sigma, refined.translation_sigma
        return RelativePose(
            rotation=refined.estimate.rotation if rotation is None else rotation,
            translation=refined.estimate.translation if rotation is None else None,
            rotation_sigma=turned if holds and np.isfinite(turned) else None,
            translation_sigma=moved if holds and np.isfinite(moved) and rotation is None else None,
            covariance=covariance if holds and np.isfinite(covariance).all() else None,
            flags=degeneracy.flags,
            alternatives=degeneracy.alternatives,
            starts=refined.estimate.starts,
        )


@dataclass(frozen=True, eq=False)
class PoseResult:
    """The pose of a matched pair. Points are px of the original images, pixel centres at +0.5."""

    cameras: tuple[Camera, Camera] | Failed  # left, right
    pose: RelativePose | Failed
    points: Correspondences  # C, of which `region` are rows of `regions`
    inliers: NDArray[np.bool_]  # (n,) of `points`
    regions: Sequence[tuple[int, int]]  # ids of the matched polygons, left and right
    rejected: Sequence[tuple[int, int]]  # ids of matched polygons whose points disagree with the pose as a whole
    found: int  # points of the whole images, before anything was filtered
    fundamental: Array | Failed  # 3 x 3
    homography: Array | Failed  # 3 x 3
    config: Mapping[str, object] = field(repr=False)
    timings: Mapping[str, float] = field(repr=False)  # stage -> seconds
    warnings: Sequence[str] = ()
    baseline: float | None = None  # distance of the cameras in the unit of the user's choice, where it is known
    version: str = field(default_factory=package_version, repr=False)

    __repr__ = brief

    @property
    def translation(self) -> Array | None:
        """(3,) t: as long as the baseline, or of unit length where that is not known; None where there is none."""
        if isinstance(self.pose, Failed) or self.pose.translation is None:
            return None
        return self.pose.translation * (self.baseline or 1.0)

    def with_baseline(self, baseline: float) -> "PoseResult":
        """The same with a metric translation."""
        if not (baseline > 0 and np.isfinite(baseline)):
            raise InputError(f"the baseline must be a positive length, got {baseline}")
        return dataclasses.replace(self, baseline=float(baseline))

    def motions_of_homography(self) -> list[tuple[Array, Array, Array]]:
        """R, t (in units of the plane's distance) and the plane's normal of each decomposition of the homography.

        Malis and Vargas, INRIA RR-6303; up to four. Empty without a homography or cameras.
        """
        if isinstance(self.homography, Failed) or isinstance(self.cameras, Failed):
            return []
        a, b = self.cameras
        plane = np.linalg.inv(b.matrix) @ self.homography @ a.matrix
        if np.linalg.det(plane) < 0:
            return []
        _, rotations, translations, normals = cv2.decomposeHomographyMat(plane, np.eye(3))
        return [
            (np.asarray(r), np.ravel(t), np.ravel(n)) for r, t, n in zip(rotations, translations, normals, strict=True)
        ]

    def all_warnings(self) -> list[str]:
        """Everything that a reader of the pose should know, in sentences."""
        warnings = list(self.warnings)
        if not isinstance(self.cameras, Failed):
            for side, camera in zip(("left", "right"), self.cameras, strict=True):
                warnings += doubts(camera, f"the {side} camera")
        if isinstance(self.pose, Failed):
            return [*warnings, f"no pose: {self.pose}"]
        warnings += [f"{name}: {FLAG_MEANINGS[name]}" for name in self.pose.flags]
        if not isinstance(self.cameras, Failed):
            for side, camera in zip(("left", "right"), self.cameras, strict=True):
                if camera.source in ("guess", "estimated"):
                    how = "guessed" if camera.source == "guess" else "estimated from the epipolar geometry"
                    warnings.append(f"the focal length of the {side} camera, {camera.focal:.0f} px, is {how}")
        return warnings

    def to_dict(self) -> dict[str, object]:
        """The content of `pose.json` (schema "zpm2-pose/1")."""
        pose = self.pose
        return {
            "schema": SCHEMA,
            "version": self.version,
            "config": dict(self.config),
            "timings": {stage: round(seconds, 4) for stage, seconds in self.timings.items()},
            "cameras": None if isinstance(self.cameras, Failed) else [c.to_dict() for c in self.cameras],
            "pose": None if isinstance(pose, Failed) else self._pose(pose),
            "failed": pose.reason if isinstance(pose, Failed) else None,
            "fundamental": _matrix(self.fundamental),
            "homography": _matrix(self.homography),
            "homography_motions": [
                {"rotation": r.tolist(), "translation": t.tolist(), "normal": n.tolist()}
                for r, t, n in self.motions_of_homography()
            ],
            "counts": self.counts(),
            "points": {
                "left": self.points.points.left.tolist(),
                "right": self.points.points.right.tolist(),
                "score": self.points.points.score.tolist(),
                "inlier": self.inliers.tolist(),
                "local": self.points.local.tolist(),
                "left_polygon": [self.regions[r][0] if r >= 0 else None for r in self.points.region],
                "right_polygon": [self.regions[r][1] if r >= 0 else None for r in self.points.region],
            },
            "rejected_regions": [list(pair) for pair in self.rejected],
            "warnings": self.all_warnings(),
        }

    def _pose(self, pose: RelativePose) -> dict[str, object]:
        essential, translation = pose.essential, self.translation
        return {
            "rotation": pose.rotation.tolist(),
            "translation": None if translation is None else translation.tolist(),
            "metric": self.baseline is not None and translation is not None,
            "essential": None if essential is None else essential.tolist(),
            "rotation_sigma_deg": pose.rotation_sigma,
            "translation_sigma_deg": pose.translation_sigma,
            "covariance_rad2": None if pose.covariance is None else pose.covariance.tolist(),
            "flags": list(pose.flags),
            "alternatives": [{"rotation": r.tolist(), "translation": t.tolist()} for r, t in pose.alternatives],
            "starts": pose.starts,
        }

    def counts(self) -> dict[str, int]:
        """How many points each step kept."""
        inside = self.points.region >= 0
        return {
            "found": self.found,
            "used": len(self.points),
            "in_regions": int(inside.sum()),
            "local": int(self.points.local.sum()),
            "inliers": int(self.inliers.sum()),
            "regions": len(self.regions),
            "regions_with_inliers": len(np.unique(self.points.region[self.inliers & inside])),
            "regions_rejected": len(self.rejected),
        }

    def save(self, directory: str | Path) -> Path:
        """Write pose.json into a folder, whole or not at all; returns its path."""
        return atomic_write(claim(directory, [NAME]) / NAME, json.dumps(self.to_dict(), allow_nan=False))


def _matrix(matrix: Array | Failed) -> list[list[float]] | None:
    return None if isinstance(matrix, Failed) else matrix.tolist()
