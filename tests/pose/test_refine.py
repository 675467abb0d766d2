"""Refinement: nearer to the truth than what it starts from, and as exact as it says."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from views import angle, rotation, views

from zpm2 import geometry
from zpm2.pose.estimators import PoseEstimate
from zpm2.pose.points import RayPairs
from zpm2.pose.refine import RefinedPose, blocks, refine

PX = 1 / 700
STEPS = 30


def refined(seed: int, noise: float, start: float = 1.0) -> tuple[float, float, RefinedPose]:
    """Errors of R and t, from a pose that is `start` degrees off."""
    of = views(seed, n=400, noise=noise)
    direction = of.direction + np.radians(start) * np.array([0, 1, 0])
    motion = PoseEstimate(
        rotation(0, 0, start) @ of.rotation, direction / np.linalg.norm(direction), np.ones(len(of.points), bool)
    )
    found = refine(motion, RayPairs(*of.rays, PX), np.arange(len(of.points)), STEPS)
    return angle(found.estimate.rotation, of.rotation), angle(found.estimate.translation, of.direction), found


def test_exact_points_give_the_exact_pose() -> None:
    turn, shift, found = refined(0, 0.0)
    assert turn < 1e-5
    assert shift < 1e-4
    assert found.rotation_sigma < 1e-4


def test_the_error_grows_with_the_noise() -> None:
    errors = [np.median([refined(seed, noise)[1] for seed in range(5)]) for noise in (0.05, 0.2, 0.8)]
    assert errors[0] < errors[1] < errors[2] < 1.0


def test_it_is_as_sure_as_it_says() -> None:
    """Squared errors over their variances are 1 in the mean; 30 draws leave a factor of 2."""
    runs = [refined(seed, 0.4, 0.0) for seed in range(30)]
    for error, sigma in (
        ([r[0] for r in runs], [r[2].rotation_sigma for r in runs]),
        ([r[1] for r in runs], [r[2].translation_sigma for r in runs]),
    ):
        assert 0.5 < np.mean((np.array(error) / np.array(sigma)) ** 2) < 2.0


def test_what_no_point_determines_has_no_sigma() -> None:
    """Points on one line: the pose turns about it freely. And a single group leaves nothing to compare it with."""
    of = views(0, n=100)
    along = np.linspace(-2, 2, 100)
    line = np.c_[along, 0.3 * along, 5 + 0.5 * along]
    rays = RayPairs(*(xyz[:, :2] / xyz[:, 2:] for xyz in (line, line @ of.rotation.T + of.translation)), PX)
    motion = PoseEstimate(of.rotation, of.direction, np.ones(100, bool))
    assert np.isinf(refine(motion, rays, np.arange(100) % 9, STEPS).translation_sigma)
    assert np.isinf(refine(motion, RayPairs(*of.rays, PX), np.zeros(100, np.intp), STEPS).translation_sigma)


def test_shared_errors_count_once() -> None:
    """Points that are repeated ten times make nothing more certain, if their groups say that they are the same."""
    of = views(3, n=100, noise=0.5)
    motion = PoseEstimate(of.rotation, of.direction, np.ones(1000, bool))
    left, right = (np.repeat(r, 10, axis=0) for r in of.rays)
    unrepeated = dataclasses.replace(motion, inliers=motion.inliers[:100])
    once = refine(unrepeated, RayPairs(*of.rays, PX), np.arange(100), STEPS)
    grouped = refine(motion, RayPairs(left, right, PX), np.repeat(np.arange(100), 10), STEPS)
    alone = refine(motion, RayPairs(left, right, PX), np.arange(1000), STEPS)
    assert grouped.rotation_sigma == pytest.approx(once.rotation_sigma, rel=0.05)
    assert alone.rotation_sigma < 0.5 * once.rotation_sigma


def test_it_is_as_sure_as_it_says_where_errors_are_alike_in_large_parts() -> None:
    """A lens that the camera does not know moves neighbours alike; outliers and points that are kept for their fit do
    not make it more certain."""
    ratios = []
    for seed in range(20):
        of = views(seed, n=600, noise=0.2, outliers=0.1)
        rng = np.random.default_rng(seed)
        left, right = of.rays
        wave = rng.normal(0, 0.7 * PX, (3, 3, 2))[tuple(np.clip((left * 3 + 1.5).astype(int), 0, 2).T)]
        motion = PoseEstimate(of.rotation, of.direction, np.ones(len(left), bool))
        for _ in range(2):
            near = geometry.sampson_distance(motion.essential, left, right + wave) < 5 * PX
            rays = RayPairs(left, right + wave, PX)
            found = refine(dataclasses.replace(motion, inliers=near), rays, blocks(left, 3), STEPS)
            motion = found.estimate
        ratios.append([angle(motion.rotation, of.rotation) / found.rotation_sigma])
        ratios[-1].append(angle(motion.translation, of.direction) / found.translation_sigma)
    assert (np.array(ratios) < 1).mean() > 0.4
    assert (np.array(ratios) < 3).mean() > 0.9


@given(st.integers(0, 200), st.integers(1, 5), st.integers(0, 10**6))
def test_blocks_are_of_like_size_and_hang_together(n: int, along: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 2))
    block = blocks(points, along)
    count = np.bincount(block, minlength=along**2)
    assert count.sum() == n
    assert np.ptp(count) <= 2
    for column in range(along - 1):
        here, next_ = (points[block // along == k, 0] for k in (column, column + 1))
        assert not len(here) or not len(next_) or here.max() <= next_.min()
