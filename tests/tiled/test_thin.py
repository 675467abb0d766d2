"""Photographs that are much longer than wide, and pairs of very different sizes."""

import numpy as np
import pytest
from test_tiled_matcher import ColourSegmenter, OrbPoints, config, iou, scene, visible, warped

from zpm2.api import Matcher
from zpm2.config import preset
from zpm2.errors import InputError
from zpm2.global_match.pair_points import PointFinder
from zpm2.model import Image, PointMatches
from zpm2.runtime import StageTimer
from zpm2.tiled.whole import in_tiles

SHIFT = ((1, 0, -14.0), (0, 1, 3.0), (0, 0, 1))


class Eye(ColourSegmenter):
    """Sees no more of a photograph than SAM does."""

    def segment(self, image):
        assert max(image.width, image.height) <= 32 * min(image.width, image.height)
        return super().segment(image)


def tall(given):
    """The scene on its side."""
    return (np.ascontiguousarray(side.transpose(1, 0, 2)) for side in (given.left, given.right))


def right_ones(result, given, swap=False):
    """How many matches are right, and how many regions both photographs show."""
    rows = {polygon.id: polygon.shape for polygon in result.left.polygons}
    columns = {polygon.id: polygon.shape for polygon in result.right.polygons}
    turn = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1.0]]) if swap else np.eye(3)
    matrix = turn @ given.matrix @ turn
    good = [iou(warped(rows[m.left], matrix), columns[m.right]) > 0.6 for m in result.matches]
    return sum(good), len(good), len(visible(given))


@pytest.mark.parametrize(("mode", "size"), [("on", 512), ("auto", 2048), ("auto", 8192)])
@pytest.mark.parametrize(("width", "height", "upright"), [(5000, 120, False), (5000, 120, True), (4000, 80, False)])
def test_a_strip_is_matched_in_tiles(width, height, upright, size, mode):
    given = scene(width, height, pitch=height - 10, matrix=SHIFT, wide=False)
    pair = tall(given) if upright else (given.left, given.right)
    settings = config(f"tiles.mode={mode}", f"tiles.size={size}")
    result = Matcher(settings, segmenter=Eye(), points=OrbPoints())(*pair)
    good, found, there = right_ones(result, given, upright)
    assert good >= 0.95 * found
    assert good > 0.8 * there


@pytest.mark.parametrize(("width", "height", "upright"), [(2300, 100, False), (2300, 100, True), (900, 100, False)])
def test_small_tiles_of_a_narrow_photograph(width, height, upright):
    given = scene(width, height, pitch=height - 10, matrix=SHIFT, wide=False)
    pair = tall(given) if upright else (given.left, given.right)
    result = Matcher(config("tiles.size=256"), segmenter=Eye(), points=OrbPoints())(*pair)
    good, found, there = right_ones(result, given, upright)
    assert good >= 0.95 * found
    assert good > 0.8 * there


def test_a_strip_without_points_in_common_finishes():
    strip = np.random.default_rng(0).integers(0, 255, (33, 100_000, 3), np.uint8)
    result = Matcher(config("tiles.mode=auto"), segmenter=Eye(), points=OrbPoints())(strip, strip)
    assert result.matches == []
    assert any("may not show the same scene" in warning for warning in result.warnings)


def test_what_is_too_thin_for_any_view_is_one_clear_line():
    strip = np.zeros((33, 900_000, 3), np.uint8)
    with pytest.raises(InputError, match="900000 x 33 px, too long and thin"):
        Matcher(config("tiles.mode=auto"), segmenter=Eye(), points=OrbPoints())(strip, strip)


@pytest.mark.parametrize("size", [(32, 32), (60, 45), (300, 60), (1500, 40)])
def test_a_right_photograph_that_is_a_small_part_of_the_left_one(size):
    given = scene(1700, 1300)
    width, height = size
    for left, right in (
        (given.left, given.left[500 : 500 + height, 150 : 150 + width]),
        (given.left[500 : 500 + height, 150 : 150 + width], given.left),
    ):
        result = Matcher(config(), segmenter=Eye(), points=OrbPoints())(left, right)
        assert (result.right.height, result.right.width) == right.shape[:2]


@pytest.mark.parametrize("width", [512, 513, 639, 641, 1025])
def test_sizes_near_multiples_of_a_tile(width):
    given = scene(width, 300, matrix=SHIFT, wide=False)
    result = Matcher(config(), segmenter=Eye(), points=OrbPoints())(given.left, given.right)
    good, found, there = right_ones(result, given)
    assert good >= 0.9 * found
    assert good > 0.8 * there


def test_sam_says_what_it_would_not_see():
    from zpm2.config import SegmentConfig
    from zpm2.segment.sam_view import SamView

    with pytest.raises(InputError, match=r"40000 x 420 px, of which the segmenter would see 1024 x 11: .*--tiles on"):
        SamView(None, Image(np.broadcast_to(np.zeros(1, np.uint8), (420, 40000, 3))), SegmentConfig())


def test_a_strip_is_not_turned():
    class Points:
        name = "points"

        def match(self, left, right):
            assert max(right.rgb.shape) < 20_000
            return PointMatches.empty()

    strip = Image(np.broadcast_to(np.zeros(1, np.uint8), (200, 10_000, 3)))
    found = PointFinder(preset("default"), "cpu", Points())((strip, strip), StageTimer(lambda stage, share: None))
    assert len(found.initial.points) == 0


@pytest.mark.parametrize(("size", "tiles"), [((4000, 3900), False), ((4000, 4001), True), ((3000, 90), True)])
def test_auto_takes_tiles_for_large_and_for_thin_photographs(size, tiles):
    class Of:
        width, height = size

    assert in_tiles([Of(), Of()], config("tiles.mode=auto")) == tiles
