"""The contract of every point matcher, on a pair whose truth is known. Learned ones need their weights. `vismatch` has
a file of its own."""

from functools import cache

import cv2
import numpy as np
import pytest

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.contract import points
from zpm2.contract.scenes import HOMOGRAPHY, texture, warped
from zpm2.errors import MissingDependency, WeightsError
from zpm2.features import METHODS, PointMatcher, create
from zpm2.geometry import project
from zpm2.model import Image, PointMatches

WIDTH, HEIGHT = 320, 256


def config(method: str, **changes: int) -> PointsConfig:
    return PointsConfig(methods=(method,), **{"max_keypoints": 400, **changes})


def build(points: PointsConfig) -> PointMatcher:
    try:
        return create(points, "cpu", 0)
    except WeightsError as error:
        if "--accept-licence" in str(error):
            pytest.skip(f"its licence was not accepted on this machine: {error}")
        if all(weights.entry(name).hash_known for name in METHODS.get(points.methods[0]).info.weights):
            raise
        pytest.skip(f"weights that only the hub has: {error}")
    except MissingDependency as error:
        pytest.skip(str(error))


@pytest.fixture(
    scope="module",
    params=[m if m == "sift" else pytest.param(m, marks=pytest.mark.weights) for m in METHODS if m != "vismatch"],
)
def matcher(request: pytest.FixtureRequest) -> PointMatcher:
    return build(config(request.param))


@pytest.fixture(scope="module")
def left() -> Image:
    return Image(texture(WIDTH, HEIGHT))


@pytest.fixture(scope="module")
def right(left: Image) -> Image:
    return Image(warped(left.rgb, HOMOGRAPHY))


@pytest.fixture(scope="module")
def found(matcher: PointMatcher, left: Image, right: Image) -> PointMatches:
    return matcher.match(left, right)


def check_form(matches: PointMatches, left: Image, right: Image) -> None:
    n = len(matches)
    for at, image in ((matches.left, left), (matches.right, right)):
        assert at.shape == (n, 2)
        assert at.dtype == np.float64
        assert ((at >= 0) & (at <= [image.width, image.height])).all()
    assert matches.score.shape == (n,)
    assert matches.score.dtype == np.float64
    assert ((matches.score >= PointsConfig().min_score) & (matches.score <= 1)).all()


@pytest.mark.parametrize("check", points.CHECKS)
def test_contract(matcher: PointMatcher, check: str) -> None:
    """What the author of a plug-in runs, `python -m zpm2.contract`."""
    points.CHECKS[check](cache(lambda side: matcher if side >= 1600 else build(config(matcher.name, max_size=side))))


def test_form(found: PointMatches, left: Image, right: Image) -> None:
    assert len(found) >= 40
    check_form(found, left, right)


def test_matches_are_right(matcher: PointMatcher, found: PointMatches) -> None:
    """`xfeat-dense` refines within cells of 8 px, with an error that depends on the shift between the cells."""
    residual = project(HOMOGRAPHY, found.left) - found.right
    distance = np.linalg.norm(residual, axis=1)
    assert np.median(distance) < 1.5
    assert (distance < 3).mean() > 0.85
    assert np.abs(residual[distance < 3].mean(0)).max() < (0.35 if matcher.name == "xfeat-dense" else 0.2)


def test_no_match_is_said_twice(found: PointMatches) -> None:
    apart = [np.linalg.norm(p[:, None] - p[None], axis=2) > 1 for p in (found.left, found.right)]
    assert (apart[0] | apart[1] | np.eye(len(found), dtype=bool)).all()


def test_an_image_matches_itself_in_place(matcher: PointMatcher, left: Image) -> None:
    crop = Image(np.ascontiguousarray(left.rgb[:192, :224]))
    matches = matcher.match(crop, crop)
    assert len(matches) >= 20
    assert np.abs((matches.left - matches.right).mean(0)).max() < 0.05


def test_no_shift_between_sizes(matcher: PointMatcher, left: Image) -> None:
    """The left image is twice as large; learned methods are told to look at both at the smaller size."""
    small = Image(cv2.resize(left.rgb, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA))
    matches = build(config(matcher.name, max_size=WIDTH // 2)).match(left, small)
    assert len(matches) >= 20
    residual = matches.left - 2 * matches.right
    assert np.abs(residual[np.linalg.norm(residual, axis=1) < 6].mean(0)).max() < 0.2
    assert np.median(np.linalg.norm(residual, axis=1)) < 1.5
