"""Pure rotations and planes are flagged, ordinary scenes are not."""

import numpy as np
import pytest
from views import Views, angle, views

from zpm2.config import DegeneracyConfig, PoseConfig
from zpm2.errors import Failed
from zpm2.pose.degeneracy import Degeneracy, examine, rotation_between
from zpm2.pose.estimators import OpenCv, PoseEstimate
from zpm2.pose.points import RayPairs
from zpm2.pose.refine import refine
from zpm2.pose.result import RelativePose

PX = 1 / 700
CONFIG = PoseConfig()


def examined(
    of: Views, sigma: float = 0.1, places: int = 12, config: PoseConfig = CONFIG
) -> tuple[PoseEstimate, Degeneracy]:
    motion = OpenCv().estimate(*of.rays, PX, 0)
    assert not isinstance(motion, Failed)
    rays = RayPairs(*of.rays, PX)
    return motion, examine(motion, rays, np.arange(len(of.points)) % places, sigma, config, 0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_an_ordinary_scene_has_no_flags(seed: int, outliers: float) -> None:
    _, seen = examined(views(seed, noise=0.3, outliers=outliers))
    assert seen.flags == ()
    assert seen.rotation_only is None
    assert seen.alternatives == ()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_a_pure_rotation(seed: int, outliers: float) -> None:
    of = views(seed, noise=0.3, outliers=outliers, shift=(0, 0, 0))
    _, seen = examined(of)
    assert "pure_rotation" in seen.flags
    assert seen.rotation_only is not None
    assert angle(seen.rotation_only, of.rotation) < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_has_its_flag_and_the_truth_is_among_the_poses(seed: int) -> None:
    of = views(seed, noise=0.2, scene="plane")
    motion, seen = examined(of)
    assert "planar_scene" in seen.flags
    poses = [(motion.rotation, motion.translation), *seen.alternatives]
    assert min(max(angle(r, of.rotation), angle(t, of.direction)) for r, t in poses) < 3.0


@pytest.mark.parametrize("seed", range(4))
def test_the_noise_that_is_assumed_hides_neither_a_rotation_nor_a_plane(seed: int) -> None:
    """A mapped point is off by the noise of both images along two axes, the Sampson distance by that of one."""
    assert "pure_rotation" in examined(views(seed, noise=0.9, shift=(0, 0, 0)))[1].flags
    assert "planar_scene" in examined(views(seed, noise=0.9, scene="plane"))[1].flags
    assert examined(views(seed, noise=0.9))[1].flags == ()


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_turn_is_known_where_a_translation_is_not(noise: float) -> None:
    of = views(0, noise=noise, shift=(0, 0, 0))
    motion, seen = examined(of)
    refined = refine(motion, RayPairs(*of.rays, PX), np.arange(len(of.points)) % 9, 30)
    pose = RelativePose.of(refined, seen)
    assert pose.translation is None is pose.translation_sigma
    assert pose.rotation_sigma is not None
    assert pose.rotation_sigma < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_points_on_one_line_are_flagged_as_planar(noise: float) -> None:
    of, rng = views(0), np.random.default_rng(0)
    along = rng.uniform(-2, 2, 300)
    left = np.c_[along, 0.3 * along, 5 + 0.5 * along]
    right = left @ of.rotation.T + of.translation
    rays = RayPairs(*(xyz[:, :2] / xyz[:, 2:] + noise * PX * rng.normal(size=(300, 2)) for xyz in (left, right)), PX)
    true = PoseEstimate(of.rotation, of.direction, np.ones(300, bool))
    seen = examine(true, rays, np.arange(300) % 12, 0.1, CONFIG, 0)
    assert seen.flags == ("planar_scene",)


def test_little_to_go_by() -> None:
    of = views(0, n=12)
    assert "few_inliers" in examined(of)[1].flags
    assert "few_regions" in examined(views(0), places=2)[1].flags
    assert "uncertain" in examined(views(0), sigma=30.0)[1].flags


def test_rotation_between_withstands_outliers() -> None:
    of = views(2, outliers=0.3, shift=(0, 0, 0))
    assert angle(rotation_between(*of.rays, PX, rounds=20), of.rotation) < 0.02


def test_the_limits_are_configured() -> None:
    strict = PoseConfig(degeneracy=DegeneracyConfig(min_regions=13, max_direction_sigma=0.05))
    assert examined(views(0), config=strict)[1].flags == ("few_regions", "uncertain")
