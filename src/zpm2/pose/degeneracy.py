"""What the points cannot tell: a camera that only turned, a scene that is one plane, too little to go by."""

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.errors import Failed
from zpm2.pose.estimators import Motion

Array = NDArray[np.float64]
EXPLAINED = 0.95  # of the inliers of a pose, from which a simpler model is taken to explain all of them
NOISE = 2.0  # thresholds within which a simpler model explains a point
FEW, FEW_SHARE = 20, 0.15  # inliers, and share of the points, below which a pose may be chance
REGIONS = 3  # matched regions that the inliers must lie in
RIVAL = 0.5  # of the inliers, from which as many other points on another pose make a pose one of two
UNSURE = 15.0  # degrees of one standard deviation, from which a direction is not known


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """Flags, empty if nothing speaks against a pose, and the poses that explain the points as well."""

    flags: tuple[str, ...]  # of "pure_rotation", "planar_scene", "few_inliers", "few_regions", "uncertain", "ambiguous"
    rotation_only: Array | None = None  # (3, 3) of "pure_rotation"
    turned: NDArray[np.bool_] | None = None  # (n,) the points that it explains
    alternatives: tuple[tuple[Array, Array], ...] = ()  # R, t of unit length, of "planar_scene"

    def beside(self, rival: int, inliers: int) -> "Degeneracy":
        """The same, flagged as ambiguous where a pose with `rival` of the other points stands beside one with
        `inliers`: repeated texture, or two motions."""
        if self.rotation_only is not None or rival < RIVAL * inliers:
            return self
        return dataclasses.replace(self, flags=(*self.flags, "ambiguous"))


def examine(
    motion: Motion, left: Array, right: Array, places: NDArray[np.intp], sigma: float, threshold: float, seed: int
) -> Degeneracy:
    """What speaks against `motion`, estimated from homologous rays (n, 2) with `threshold`.

    places: (n,) the region of each point, negative for one outside of matched regions. sigma: degrees, of the direction
    of t.
    """
    near = geometry.sampson_distance(motion.essential, left, right) <= NOISE * threshold
    turn = rotation_between(left[near], right[near], threshold)
    turned = np.linalg.norm(geometry.turn_rays(turn, left) - right, axis=1) <= NOISE * threshold
    rotates = turned[near].mean() >= EXPLAINED if near.any() else False  # where nothing moves, nothing is in front
    agree = turned if rotates else motion.inliers
    flags = []
    if agree.sum() < max(FEW, FEW_SHARE * len(left)):
        flags.append("few_inliers")
    if len(np.unique(places[agree & (places >= 0)])) < REGIONS:
        flags.append("few_regions")
    if rotates:
        return Degeneracy((*flags, "pure_rotation"), turn, agree)
    a, b = left[agree], right[agree]
    alternatives: tuple[tuple[Array, Array], ...] = ()
    plane = geometry.homography(a, b, NOISE * threshold, seed)
    if not isinstance(plane, Failed) and plane[1].mean() >= EXPLAINED:
        flags.append("planar_scene")
        alternatives = _other_motions(plane[0], motion, a, b, threshold)
    if sigma > UNSURE:
        flags.append("uncertain")
    return Degeneracy(tuple(flags), alternatives=alternatives)


def rotation_between(left: Array, right: Array, threshold: float) -> Array:
    """(3, 3) R with right ~ R left for homologous rays (n, 2): Kabsch (1976) on unit vectors, reweighted (Cauchy)."""
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in map(geometry.homogeneous, (left, right)))
    weight, rotation = np.ones(len(a)), np.eye(3)
    for _ in range(20):
        u, _, v = np.linalg.svd((b * weight[:, None]).T @ a)
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        error = np.linalg.norm(a @ rotation.T - b, axis=1) / threshold
        weight = 1 / (1 + error**2)
    return np.asarray(rotation)


def _other_motions(
    plane: Array, motion: Motion, left: Array, right: Array, threshold: float
) -> tuple[tuple[Array, Array], ...]:
    """The motions of a plane's homography (of rays) under which the points lie before both cameras and agree as well as
    under `motion`, but for that one itself (Malis and Vargas, INRIA RR-6303)."""
    if np.linalg.det(plane) < 0:
        return ()
    _, rotations, translations, _ = cv2.decomposeHomographyMat(plane, np.eye(3))
    found: list[tuple[Array, Array]] = []
    for rotation, direction in zip(rotations, translations, strict=True):
        length = np.linalg.norm(direction)
        if length < 1e-9:
            continue
        translation = direction.ravel() / length
        essential = geometry.cross_matrix(translation) @ rotation
        agree = geometry.sampson_distance(essential, left, right) <= NOISE * threshold
        before = geometry.in_front(rotation, translation, left, right)
        same = np.trace(rotation @ motion.rotation.T) > 1 + 2 * np.cos(np.radians(1.0))
        if (agree & before).mean() >= EXPLAINED and not (same and translation @ motion.translation > 0.9998):
            found.append((np.asarray(rotation), translation))
    return tuple(found)
