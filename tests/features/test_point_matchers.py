"""The contract of every point matcher, on a pair whose truth is known. Learned ones need their weights."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from zpm2.config import PointsConfig
from zpm2.errors import WeightsError
from zpm2.features import METHODS, PointMatcher, create
from zpm2.geometry import project
from zpm2.model import Image, PointMatches

WIDTH, HEIGHT = 320, 256
HOMOGRAPHY = np.array([[0.96, 0.07, 6.0], [-0.05, 1.01, 9.0], [4e-5, -3e-5, 1.0]])  # image px, centres at +0.5


def texture(width: int, height: int, seed: int = 0) -> NDArray[np.uint8]:
    """(height, width, 3) something like a photograph: octaves of smooth noise, and shapes with edges and corners."""
    random = np.random.default_rng(seed)
    out = np.zeros((height, width, 3), np.float32)
    for octave in range(6):
        noise = random.standard_normal(out.shape).astype(np.float32)
        noise = cv2.GaussianBlur(noise, (0, 0), 2.0**octave)
        out += noise / noise.std() * 2.0 ** (octave / 2)
    for _ in range(60):
        x, y, side = (int(random.integers(0, n)) for n in (width, height, 40))
        colour = tuple(float(c) for c in random.normal(0, 4, 3))
        if random.random() < 0.5:
            cv2.circle(out, (x, y), 3 + side // 2, colour, -1, cv2.LINE_AA)
        else:
            cv2.rectangle(out, (x, y), (x + 5 + side, y + int(random.integers(5, 40))), colour, -1)
    out = cv2.GaussianBlur(out, (0, 0), 0.7)
    return np.clip((out - out.mean()) / out.std() * 45 + 128, 0, 255).astype(np.uint8)


def warped(rgb: NDArray[np.uint8], homography: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The same picture after `homography`, which is in image px; OpenCV counts pixel centres from 0."""
    centre = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix = np.linalg.inv(centre) @ homography @ centre
    size = (rgb.shape[1], rgb.shape[0])
    return np.asarray(cv2.warpPerspective(rgb, matrix, size, flags=cv2.INTER_CUBIC), np.uint8)


def config(method: str, **changes: int) -> PointsConfig:
    return PointsConfig(methods=(method,), **{"max_keypoints": 400, **changes})


def build(points: PointsConfig) -> PointMatcher:
    try:
        return create(points, "cpu", 0)
    except WeightsError as error:
        if "--accept-licence" not in str(error):
            raise
        pytest.skip(f"its licence was not accepted on this machine: {error}")


@pytest.fixture(
    scope="module", params=[m if m == "sift" else pytest.param(m, marks=pytest.mark.weights) for m in METHODS]
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
    for points, image in ((matches.left, left), (matches.right, right)):
        assert points.shape == (n, 2)
        assert points.dtype == np.float64
        assert ((points >= 0) & (points <= [image.width, image.height])).all()
    assert matches.score.shape == (n,)
    assert matches.score.dtype == np.float64
    assert ((matches.score >= PointsConfig().min_score) & (matches.score <= 1)).all()


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


def test_same_bytes_again(matcher: PointMatcher, found: PointMatches, left: Image, right: Image) -> None:
    again = matcher.match(left, right)
    for name in ("left", "right", "score"):
        assert getattr(again, name).tobytes() == getattr(found, name).tobytes()


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


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (32, 32), (4000, 5), (5, 4000)])
def test_small_and_thin_images(matcher: PointMatcher, size: tuple[int, int]) -> None:
    image = Image(texture(*size))
    check_form(matcher.match(image, image), image, image)


@pytest.mark.parametrize("grey", [0, 127, 255])
def test_nothing_to_see(matcher: PointMatcher, grey: int) -> None:
    blank, other = Image(np.full((60, 70, 3), grey, np.uint8)), Image(texture(64, 64))
    assert len(matcher.match(blank, blank)) == 0
    assert len(matcher.match(blank, other)) == 0
    assert len(matcher.match(other, blank)) == 0
