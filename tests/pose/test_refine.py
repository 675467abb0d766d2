"""Refinement: nearer to the truth than what it starts from, and as sure as it says."""

import dataclasses

import numpy as np
import pytest
from views import angle, rotation, views

from zpm2.pose.estimators import Motion
from zpm2.pose.refine import Refined, refine

PX = 1 / 700


def refined(seed: int, noise: float, start: float = 1.0) -> tuple[float, float, Refined]:
    """Errors of R and t, from a pose that is `start` degrees off."""
    of = views(seed, n=400, noise=noise)
    direction = of.direction + np.radians(start) * np.array([0, 1, 0])
    motion = Motion(
        rotation(0, 0, start) @ of.rotation, direction / np.linalg.norm(direction), np.ones(len(of.points), bool)
    )
    found = refine(motion, *of.rays, np.arange(len(of.points)), PX)
    return angle(found.motion.rotation, of.rotation), angle(found.motion.translation, of.direction), found


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


def test_shared_errors_count_once() -> None:
    """Points that are said ten times make nothing surer, if it is known that they are the same."""
    of = views(3, n=100, noise=0.5)
    motion = Motion(of.rotation, of.direction, np.ones(1000, bool))
    left, right = (np.repeat(r, 10, axis=0) for r in of.rays)
    once = refine(dataclasses.replace(motion, inliers=motion.inliers[:100]), *of.rays, np.arange(100), PX)
    grouped = refine(motion, left, right, np.repeat(np.arange(100), 10), PX)
    alone = refine(motion, left, right, np.arange(1000), PX)
    assert grouped.rotation_sigma == pytest.approx(once.rotation_sigma, rel=0.05)
    assert alone.rotation_sigma < 0.5 * once.rotation_sigma
