"""Pairs on which a matcher is tempted to make things up, with the real networks."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from remembered import remembered
from rendered import Pair, photograph

from zpm2 import MatchResult
from zpm2.config import assign, preset
from zpm2.pipeline import PairMatcher

pytestmark = pytest.mark.weights

Picture = NDArray[np.uint8]


@pytest.fixture(scope="module", autouse=True)
def networks() -> Iterator[None]:
    """Loaded once, and asked once about one picture."""
    with remembered():
        yield


@pytest.fixture(scope="module")
def matcher() -> PairMatcher:
    return quick(8)


def quick(grid: int) -> PairMatcher:
    """Few prompts and points, no closer look."""
    settings = [f"segment.grid={grid}", "points.max_keypoints=1000", "segment.detail.level=off", "device=cpu"]
    return PairMatcher(assign(preset("default"), settings))


def confident(result: MatchResult) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Centres, left and right, of matches above confidence 0.5."""
    centers = [{p.id: p.center for p in side.polygons} for side in (result.left, result.right)]
    return [(centers[0][m.left], centers[1][m.right]) for m in result.matches if m.confidence > 0.5]


def facade(columns: int = 7, shift: int = 0) -> Picture:
    """A wall of alike windows, a door in one place; the view begins `shift` px to the right."""
    random = np.random.default_rng(0)
    wall = np.full((360, 900, 3), (150, 140, 120), np.float32)
    wall += cv2.resize(random.normal(0, 8, (180, 450, 3)).astype(np.float32), (900, 360))
    for column in range(14):
        for row in range(4):
            x, y = 20 + column * 64, 20 + row * 80
            cv2.rectangle(wall, (x, y), (x + 40, y + 56), (60, 70, 90), -1)
            cv2.line(wall, (x + 20, y), (x + 20, y + 56), (200, 200, 200), 3)
    cv2.rectangle(wall, (330, 250), (410, 358), (40, 40, 160), -1)
    cv2.circle(wall, (520, 90), 34, (30, 160, 60), -1)
    return np.clip(wall[:, shift : shift + columns * 64 + 192], 0, 255).astype(np.uint8)


def test_unrelated_photographs_give_no_match_to_rely_on(matcher: PairMatcher, pair: Pair) -> None:
    result = matcher(pair.left, photograph(3))
    assert confident(result) == []
    assert any("may not show the same scene" in warning for warning in result.warnings)


def test_repeated_windows_are_not_taken_for_each_other() -> None:
    found = confident(quick(16)(facade(), facade(shift=32)))
    assert len(found) >= 10
    moves = np.array([b - a for a, b in found])
    assert np.mean(np.abs(moves - [-32, 0]).max(1) < 12) >= 0.95


def test_a_mirrored_photograph(matcher: PairMatcher) -> None:
    image = photograph(3)
    width = image.shape[1]
    result = matcher(image, np.ascontiguousarray(image[:, ::-1]))
    found = confident(result)
    assert not found or any("is mirrored" in warning for warning in result.warnings)
    assert all(np.abs(b - [width - a[0], a[1]]).max() < 0.1 * width for a, b in found)


@pytest.mark.parametrize("value", [0, 120])
def test_a_uniform_image_finishes(matcher: PairMatcher, value: int) -> None:
    flat = np.full((120, 200, 3), value, np.uint8)
    result = matcher(flat, flat)
    assert confident(result) == []
    assert result.warnings


def test_a_starfield_finishes(matcher: PairMatcher) -> None:
    random = np.random.default_rng(1)
    sky = np.zeros((300, 400, 3), np.uint8)
    for x, y in random.integers(4, 296, (150, 2)):
        cv2.circle(sky, (int(x), int(y)), int(random.integers(1, 3)), (255, 255, 240), -1)
    moved = np.roll(sky, 9, axis=1)
    for a, b in confident(matcher(sky, moved)):
        assert np.abs(b - a - [9, 0]).max() < 6
