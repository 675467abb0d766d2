"""What a person points at, in both photographs."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from squares import PLACES, SHIFT, SIDE, pair, photographs, quick, square

from zpm2 import Matcher
from zpm2.app import pair as module
from zpm2.app.pair import Pair
from zpm2.app.photograph import read
from zpm2.app.prompt import Prompt, prompt_of, shape_from
from zpm2.config import assign, with_options
from zpm2.errors import ConfigError, InputError
from zpm2.model import Image, Polygon
from zpm2.pipeline import PairMatcher
from zpm2.segment.predictions import MaskPredictions


@pytest.fixture(scope="module")
def shown() -> Pair:
    found = pair()
    found.prepare()
    return found


def truth(number: int, side: int = 0) -> shapely.Polygon:
    return shapely.Polygon(square(number, side)[0][0])


def iou(a: shapely.Geometry | None, b: shapely.Geometry) -> float:
    return 0.0 if a is None else float(a.intersection(b).area / a.union(b).area)


def clicked(number: int, side: int) -> Prompt:
    x, y = PLACES[number]
    return prompt_of({"points": [[x - SHIFT * side + SIDE / 2, y + SIDE / 2, 1]], "box": None})


@pytest.mark.parametrize("side", [0, 1])
def test_a_click_in_either_photograph_finds_the_region_in_both(shown: Pair, side: int) -> None:
    drawn = shown.draw(side, clicked(1, side))
    assert iou(drawn.shape, truth(1, side)) > 0.9
    found = shown.carry(side, drawn.shape)
    assert found.status == "found"
    assert iou(found.shape, truth(1, 1 - side)) > 0.9
    assert np.allclose(found.place, truth(1, 1 - side).centroid.coords[0], atol=2)


def test_it_is_what_carry_says_of_the_region(shown: Pair) -> None:
    shape = shape_from(square(2))
    found = shown.carry(0, shape)
    matcher = Matcher(quick())
    (same,) = matcher.carry(*photographs(), [Polygon(0, shapely.get_coordinates(shape)[:-1])]).outcomes
    assert found.shape.equals_exact(same.shape, 0)
    assert replace(found, shape=None).__dict__ == replace(same, shape=None).__dict__


def test_the_person_chooses_among_sizes(shown: Pair) -> None:
    areas = [shown.draw(0, replace(clicked(0, 0), size=size)).shape.area for size in range(3)]
    assert areas == sorted(areas)
    assert shown.draw(0, replace(clicked(0, 0), size=99)).shape.area >= areas[-1]
    best = shown.draw(0, clicked(0, 0))
    assert shown.draw(0, replace(clicked(0, 0), size=best.size)).shape.equals(best.shape)


def test_answers_that_hold_the_points_come_first() -> None:
    bits = np.zeros((3, 16, 16), bool)
    bits[0, :, :8], bits[1], bits[2, :8] = True, True, True
    logits = np.where(bits, 1, -1).astype(np.float16)
    masks = MaskPredictions(np.zeros(3, np.int64), np.ones(3, np.float32), np.ones(3, np.float32), logits)
    prompt = Prompt(np.array([[2.0, 20.0]]), np.array([[28.0, 2.0], [29.0, 1.0]]), None, None)
    assert module._right_side(masks, prompt, np.array([0.5, 0.5])).tolist() == [True, False, False]
    nothing = prompt_of({"points": [], "box": [1, 1, 9, 9]})
    assert module._right_side(masks, nothing, np.ones(2)).all()
    assert module._right_side(MaskPredictions.none((16, 16)), prompt, np.ones(2)).tolist() == []


def test_large_photographs_are_reduced_and_told_in_their_own_px() -> None:
    config = quick()
    small = replace(config, carry=replace(config.carry, window=256))  # 512 px are seen as a whole
    left, right = (Image(np.ascontiguousarray(each.rgb.repeat(2, 0).repeat(2, 1))) for each in photographs())
    sides = read(left, "left.png", "left", small), read(right, "right.png", "right", small)
    assert (sides[0].width, sides[0].image.width) == (640, 512)
    assert "512 x 384 of its 640 x 480 px" in sides[0].messages[-1]
    found = Pair(sides, PairMatcher(small), lambda stage, share: None)
    drawn = found.draw(0, replace(clicked(1, 0), inside=2 * clicked(1, 0).inside))
    assert iou(drawn.shape, shapely.affinity.scale(truth(1), 2, 2, origin=(0, 0))) > 0.85
    outcome = found.carry(0, drawn.shape)
    assert iou(outcome.shape, shapely.affinity.scale(truth(1, 1), 2, 2, origin=(0, 0))) > 0.85
    assert outcome.place[0] > 320
    points = found.points
    assert np.median(points.left - points.right, axis=0) == pytest.approx([2 * SHIFT, 0], abs=1)
    ones = np.ones((len(points), 1))
    far = np.abs(np.einsum("ni,ij,nj->n", np.c_[points.right, ones], found.fundamental, np.c_[points.left, ones]))
    assert np.median(far / np.linalg.norm((np.c_[points.left, ones] @ found.fundamental.T)[:, :2], axis=1)) < 2
    mapped = np.c_[points.left, ones] @ found.homography.T
    assert np.median(np.abs(mapped[:, :2] / mapped[:, 2:] - points.right)) < 2


def test_photographs_without_common_points_say_so() -> None:
    other = Image(np.full((240, 320, 3), 128, np.uint8))
    config = assign(quick(), ["points.escalate.on=false"])
    sides = read(photographs()[0], "a", "left", config), read(other, "b", "right", config)
    found = Pair(sides, PairMatcher(config), lambda stage, share: None)
    found.prepare()
    assert any("too few points" in message for message in found.messages)
    assert found.carry(0, shape_from(square(1))).status == "not found"


def test_misuse(shown: Pair) -> None:
    outside = prompt_of({"points": [[-1e6, 5, 1]], "box": None})
    assert shown.draw(0, outside).shape.area > 0  # the nearest pixel
    far = shape_from([[[[900, 900], [950, 900], [950, 950]]]])
    assert shown.carry(0, far).status in ("outside", "not found")
    config = with_options(quick(), {"max_memory": "1MB"})
    with pytest.raises(InputError, match="memory"):
        pair(config)


def test_a_segmenter_without_prompts_is_refused() -> None:
    class Plain:
        name = "plain"

        def segment(self, image: Image) -> list[object]:
            return []

    config = quick()
    sides = tuple(read(each, "a", "left", config) for each in photographs())
    found = Pair(sides, PairMatcher(config, segmenter=Plain()), lambda stage, share: None)
    with pytest.raises(ConfigError, match="takes no prompts"):
        found.draw(0, clicked(0, 0))
