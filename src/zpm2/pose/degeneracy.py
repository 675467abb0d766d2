"""Detects points that do not determine a pose: the camera only rotated, one plane, too few points that agree."""

import dataclasses
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import DegeneracyConfig, PoseConfig
from zpm2.errors import Failed
from zpm2.pose.estimators import PoseEstimate
from zpm2.pose.points import RayPairs

Array = NDArray[np.float64]
# 95 % of normal noise: of the distance of a mapped point (two axes, the noise of both images) by the Sampson distance
TO_MAPPED = math.sqrt(2 * 5.991 / 3.841)
NO_TRANSLATION = 1e-9  # share of the plane's distance; a shorter translation has no direction


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """Flags, none for a sound pose, and the other poses that explain the points as well."""

    flags: tuple[str, ...]  # of "pure_rotation", "planar_scene", "few_inliers", "few_regions", "uncertain", "ambiguous"
    rotation_only: Array | None = None  # (3, 3) of "pure_rotation"
    rotated: NDArray[np.bool_] | None = None  # (n,) the points that it explains
    alternatives: tuple[tuple[Array, Array], ...] = ()  # R, t of unit length, of "planar_scene"

    def with_rival(self, rival: int, inliers: int, config: DegeneracyConfig) -> "Degeneracy":
        """The same, flagged as ambiguous if too many of the other points (`rival`) agree on another pose.

        inliers: the points that agree on this pose. Causes are repeated texture, or two motions.
        """
        if self.rotation_only is not None or rival < config.rival * inliers:
            return self
        return dataclasses.replace(self, flags=(*self.flags, "ambiguous"))


def examine(
    estimate: PoseEstimate, rays: RayPairs, places: NDArray[np.intp], sigma: float, config: PoseConfig, seed: int
) -> Degeneracy:
    """Reasons to doubt a pose that was estimated from n homologous rays.

    places: (n,) the region of each point, negative for one outside of matched regions. sigma: degrees, of the direction
    of t.
    """
    limits, noise = config.degeneracy, TO_MAPPED * config.inlier * rays.noise
    near = rays.near(estimate.essential, config.inlier)
    rotation = rotation_between(rays.left[near], rays.right[near], rays.noise, limits.rotation_rounds)
    away = np.linalg.norm(geometry.turn_rays(rotation, rays.left) - rays.right, axis=1)
    rotated = away <= noise
    # all points, not only the inliers: if the camera only rotated, no point can be shown to lie before both views
    only_turned = rotated[near].mean() >= limits.explained if near.any() else False
    agree = rotated if only_turned else estimate.inliers
    flags = []
    if agree.sum() < max(limits.min_inliers, limits.min_inlier_share * len(rays)):
        flags.append("few_inliers")
    if len(np.unique(places[agree & (places >= 0)])) < limits.min_regions:
        flags.append("few_regions")
    if only_turned:
        return Degeneracy((*flags, "pure_rotation"), rotation, agree)
    inliers = rays[agree]
    alternatives: tuple[tuple[Array, Array], ...] = ()
    plane = geometry.homography(inliers.left, inliers.right, noise, seed, config.magsac)
    if min(beside_a_line(side, noise) for side in (inliers.left, inliers.right)) <= 1 - limits.explained:
        flags.append("planar_scene")  # any plane through the line
    elif not isinstance(plane, Failed) and plane[1].mean() >= limits.explained:
        flags.append("planar_scene")
        alternatives = _other_poses(plane[0], estimate, inliers, config)
    if sigma > limits.max_direction_sigma:
        flags.append("uncertain")
    return Degeneracy(tuple(flags), alternatives=alternatives)


def rotation_between(left: Array, right: Array, threshold: float, rounds: int) -> Array:
    """(3, 3) R with right ~ R left for homologous rays (n, 2): Kabsch (1976) on unit vectors, `rounds`
    times, each point weighted by its error (Cauchy)."""
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in map(geometry.homogeneous, (left, right)))
    weight, rotation = np.ones(len(a)), np.eye(3)
    for _ in range(rounds):
        u, _, v = np.linalg.svd((b * weight[:, None]).T @ a)
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        error = np.linalg.norm(a @ rotation.T - b, axis=1) / threshold
        weight = 1 / (1 + error**2)
    return np.asarray(rotation)


def beside_a_line(points: Array, distance: float) -> float:
    """0..1, the share of points (n, 2) that lie farther from their common line (least squares) than `distance`."""
    if not len(points):
        return 0.0
    away = points - points.mean(0)
    return float((np.abs(away @ np.linalg.eigh(away.T @ away)[1][:, 0]) > distance).mean())


def _other_poses(
    plane: Array, estimate: PoseEstimate, rays: RayPairs, config: PoseConfig
) -> tuple[tuple[Array, Array], ...]:
    """The poses that a plane's homography (of rays) allows beside `estimate`: those under which the points lie before
    both cameras and agree as well (Malis and Vargas, INRIA RR-6303)."""
    limits = config.degeneracy
    if np.linalg.det(plane) < 0:  # it mirrors
        return ()
    _, rotations, translations, _ = cv2.decomposeHomographyMat(plane, np.eye(3))
    found: list[tuple[Array, Array]] = []
    for rotation, direction in zip(rotations, translations, strict=True):
        length = np.linalg.norm(direction)
        if length < NO_TRANSLATION:
            continue
        translation = direction.ravel() / length
        essential = geometry.cross_matrix(translation) @ rotation
        agree = rays.near(essential, config.inlier)
        before = geometry.in_front(rotation, translation, rays.left, rays.right)
        near = np.cos(np.radians(limits.same_rotation))
        same = np.trace(rotation @ estimate.rotation.T) > 1 + 2 * near
        same &= translation @ estimate.translation > limits.same_direction
        if (agree & before).mean() >= limits.explained and not same:
            found.append((np.asarray(rotation), translation))
    return tuple(found)
