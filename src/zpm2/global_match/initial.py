"""Initial matching (paper 3.3.1): F first, then H from the points near their epipolar lines."""

from dataclasses import dataclass, field
from functools import cached_property
from math import log10

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import ChanceConfig, GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match.chance import is_mirrored, log_chance, same_scene
from zpm2.model import Image, PointMatches
from zpm2.polygons.warp import WarpingPoints

Warping = tuple[WarpingPoints, NDArray[np.float64] | Failed]  # points, and H


@dataclass(frozen=True, eq=False)
class PriorLocations:
    """Where n left polygons should be in the right image, before the pyramid searches."""

    centers: NDArray[np.float64]  # (n, 2) right image px; NaN where H has no image of a centre
    linear: NDArray[np.float64]  # (n, 2, 2) the local affine part of the map from left to right


@dataclass(frozen=True, eq=False)
class InitialGeometry:
    """The geometry of the pair as a whole, from the homologous points.

    All points stay in `points`: those far from their epipolar line are not used for H but are kept (3.3.1).
    """

    points: PointMatches  # all of them, (n, 2) image px
    fundamental: NDArray[np.float64] | Failed  # 3 x 3, p_right^T F p_left = 0
    homography: NDArray[np.float64] | Failed  # 3 x 3, p_right ~ H p_left
    consistent: NDArray[np.bool_]  # (n,) near the epipolar line; all True where there is no F
    planar: NDArray[np.bool_]  # (n,) inliers of H; all False where there is no H
    limits: ChanceConfig = field(default_factory=ChanceConfig)  # what counts as more than chance
    trials: int = 1  # searches that the points were chosen from

    def prior_locations(self, centers: NDArray[np.float64]) -> PriorLocations:
        """The (n, 2) centres of left polygons mapped by H; unchanged where there is no H."""
        if isinstance(self.homography, Failed):
            return PriorLocations(centers.copy(), np.tile(np.eye(2), (len(centers), 1, 1)))
        linear = geometry.homography_jacobian(self.homography, centers)
        return PriorLocations(geometry.project(self.homography, centers), linear)

    def forward(self) -> Warping:
        """The points that agree with F, and H, from left to right: what `polygons.warp` warps left polygons by."""
        return self._forward

    def backward(self) -> Warping:
        """The same from right to left."""
        return self._backward

    @cached_property
    def _forward(self) -> Warping:
        return WarpingPoints.of(self.points[self.consistent]), self.homography

    @cached_property
    def _backward(self) -> Warping:
        points, homography = self._forward
        inverse = homography if isinstance(homography, Failed) else np.asarray(np.linalg.inv(homography), np.float64)
        return WarpingPoints(points.right, points.left, points.score), inverse

    @property
    def agreeing(self) -> int:
        """How many points agree on one epipolar geometry; 0 without F."""
        return 0 if isinstance(self.fundamental, Failed) else int(self.consistent.sum())

    @cached_property
    def chance(self) -> float:
        """log10 of how many epipolar geometries as good as F are expected by chance; 0 where there is no F."""
        if isinstance(self.fundamental, Failed) or not len(self.points):
            return 0.0
        found = log_chance(self.fundamental, self.points, self.consistent, sample=7, models=3, config=self.limits)
        return found + log10(self.trials)

    @property
    def supported(self) -> bool:
        """Whether the points agree better than by chance, so that both photographs show the same scene."""
        return self.chance <= -self.limits.significance

    @property
    def same_scene(self) -> float:
        """0..1, the probability that both photographs show the same scene."""
        return same_scene(self.chance, self.limits)

    @cached_property
    def mirrored(self) -> bool:
        """Whether one of the photographs is a mirror image of what a camera sees."""
        return self.supported and is_mirrored(self.points, self.consistent, self.limits)


def initial_geometry(points: PointMatches, config: GlobalConfig, seed: int, trials: int = 1) -> InitialGeometry:
    """F by MAGSAC++, the epipolar filter, and H by MAGSAC++ on the points that pass it.

    The distance to the epipolar line is in px (Sampson), so that the threshold means the same in every pair; the
    printed |p^T F p| <= epsilon depends on F's arbitrary scale. Without F, H is estimated from all points.
    """
    all_points = np.ones(len(points), bool)
    fundamental = geometry.fundamental_matrix(points.left, points.right, config.epipolar_px, seed, config.magsac)
    if isinstance(fundamental, Failed):
        matrix: NDArray[np.float64] | Failed = fundamental
        consistent = all_points
    else:
        matrix, _ = fundamental
        consistent = geometry.epipolar_inliers(matrix, points.left, points.right, config.epipolar_px)
    homography = geometry.homography(
        points.left[consistent], points.right[consistent], config.homography_px, seed, config.magsac
    )
    planar = np.zeros(len(points), bool)
    if isinstance(homography, Failed):
        return InitialGeometry(points, matrix, homography, consistent, planar, config.chance, trials)
    planar[np.flatnonzero(consistent)[homography[1]]] = True
    return InitialGeometry(points, matrix, homography[0], consistent, planar, config.chance, trials)


def points_with_data(points: PointMatches, images: tuple[Image, Image]) -> PointMatches:
    """The points that lie on pixels with data, in both images."""
    for side, image in zip(("left", "right"), images, strict=True):
        if image.valid is not None:
            column, row = np.clip(getattr(points, side), 0, [image.width - 1, image.height - 1]).astype(np.intp).T
            points = points[image.valid[row, column]]
    return points
