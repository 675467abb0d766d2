"""The turn and the zoom between two photographs, found at a small size."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2 import features, geometry
from zpm2.config import CoarseConfig, PointsConfig
from zpm2.contract.scenes import texture, warped
from zpm2.global_match.coarse import apart, hints, similarity
from zpm2.model import Image, PointMatches

CONFIG = CoarseConfig()


def matches(turn: float, scale: float, n: int, wrong: int, seed: int) -> PointMatches:
    """n points of a similarity with relief of a few px, and wrong ones all over the image."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 600, (n + wrong, 2))
    c, s = scale * math.cos(math.radians(turn)), scale * math.sin(math.radians(turn))
    right = (left - 300) @ np.array([[c, -s], [s, c]]).T + 400 + rng.normal(0, 3 * scale, left.shape)
    right[n:] = rng.uniform(0, 800, (wrong, 2))
    return PointMatches(left, right, np.ones(n + wrong))


@given(st.floats(-180, 180), st.floats(0.3, 4), st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_similarity_is_found_among_wrong_points(turn: float, scale: float, seed: int) -> None:
    found = similarity(matches(turn, scale, 30, 40, seed), 40.0)
    assert found is not None
    assert apart(found.turn, -turn) < 10  # the right photograph is turned back
    assert found.scale == pytest.approx(scale, rel=0.2)
    assert found.chance < -CONFIG.significance


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_points_of_nothing_are_no_evidence(seed: int) -> None:
    found = similarity(matches(0, 1, 0, 60, seed), 40.0)
    assert found is None or found.chance > -CONFIG.significance


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_points_have_no_similarity(n: int) -> None:
    assert similarity(matches(0, 1, n, 0, 0), 40.0) is None


def test_points_in_one_place_are_no_evidence() -> None:
    same = np.full((20, 2), 50.0)
    found = similarity(PointMatches(same, same, np.ones(20)), 40.0)
    assert found is None or found.chance > -CONFIG.significance


def sift_only(method: str, keypoints: int) -> features.PointMatcher | None:
    """It needs no weights."""
    chosen = PointsConfig(methods=("sift",), max_keypoints=keypoints)
    return features.create(chosen) if method == "sift" else None


@pytest.mark.parametrize(("turn", "zoom"), [(0, 1.0), (150, 1.0), (-70, 2.0), (150, 4.0), (35, 0.25)])
def test_turn_and_zoom_of_a_texture(turn: float, zoom: float) -> None:
    left = Image(texture(960, 720))
    truth = np.vstack([cv2.getRotationMatrix2D((480, 360), turn, zoom), [0, 0, 1]])
    right = Image(warped(left.rgb, truth))
    found = hints((left, right), sift_only, CONFIG)
    jacobian = geometry.homography_jacobian(truth, np.array([[480.0, 360.0]]))[0]
    assert len(found) == 1
    assert apart(found[0].turn, -math.degrees(math.atan2(jacobian[1, 0], jacobian[0, 0]))) < 3
    assert found[0].scale == pytest.approx(zoom, rel=0.05)
    assert found[0].seen_at == found[0].turn  # SIFT sees the same at any turn
    assert "sift sees a turn" in str(found[0])
    assert hints((left, right), sift_only, CONFIG) == found


def test_unrelated_textures_give_no_hint() -> None:
    rng = np.random.default_rng(0)
    images = [Image(cv2.blur(rng.integers(0, 255, (480, 640, 3), np.uint8), (k, k))) for k in (3, 5)]
    assert hints((images[0], images[1]), sift_only, CONFIG) == []
