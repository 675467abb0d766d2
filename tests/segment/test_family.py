"""Elements that repeat: from one brick of a wall to the others."""

import dataclasses

import cv2
import numpy as np
import pytest
import shapely
from painted import PaintedView, Region, blank

from zpm2.config import FamilyConfig, SegmentConfig
from zpm2.model import Image
from zpm2.segment import family
from zpm2.segment.family import with_families
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts

CONFIG = SegmentConfig(min_area=20.0, family=FamilyConfig(max_prompts=200))
LOOSE = MaskThresholds(0.7, 0.85)
MISSING = (3, 4)  # row and column of a brick that the wall lacks


def bricks() -> dict[tuple[int, int], shapely.Polygon]:
    """24 x 12 px each, with joints of 4 px, every second row moved by half a brick."""
    found = {}
    for row in range(15):
        for column in range(8):
            x, y = 4 + 28 * column + 14 * (row % 2), 4 + 16 * row
            found[row, column] = shapely.box(x, y, x + 24, y + 12)
    del found[MISSING]
    return found


def wall() -> Image:
    """A wall of 256 x 256 px with a grain of its own."""
    pixels = np.full((256, 256), 200.0)
    for brick in bricks().values():
        x0, y0, x1, y1 = map(int, brick.bounds)
        pixels[y0:y1, x0:x1] = 110
    pixels += np.random.default_rng(1).normal(0, 6, pixels.shape)
    return Image(np.repeat(np.clip(pixels, 0, 255).astype(np.uint8)[..., None], 3, 2))


def view(image: Image | None = None) -> PaintedView:
    """A point finds the brick of row 6 and column 3 only; boxes find them all."""
    regions = [Region(shape, prompt_only=key != (6, 3)) for key, shape in bricks().items()]
    return PaintedView(wall() if image is None else image, regions)


def one(seen: PaintedView) -> MaskPredictions:
    x, y = bricks()[6, 3].centroid.coords[0]
    found = seen.predict(Prompts.at(np.array([[x, y]])), LOOSE)
    assert len(found) == 1
    return found


def test_one_brick_finds_the_wall() -> None:
    seen = view()
    found = with_families(seen, one(seen), CONFIG, LOOSE)
    assert len(found) > 0.85 * len(bricks())
    assert len({bits.tobytes() for bits in found.bits}) == len(found)
    assert np.array_equal(found.bits[0], one(seen).bits[0])


def test_a_missing_brick_is_not_invented() -> None:
    seen = view()
    found = with_families(seen, one(seen), CONFIG, LOOSE)
    x, y = 4 + 28 * MISSING[1] + 14 + 12, 4 + 16 * MISSING[0] + 6
    assert not found.bits[:, y, x].any()


def test_known_bricks_are_not_asked_for_again() -> None:
    seen = view()
    first = with_families(seen, one(seen), CONFIG, LOOSE)
    asked = len(seen.asked)
    again = with_families(seen, first, CONFIG, LOOSE)
    assert len(seen.asked) - asked < 0.15 * len(bricks())
    assert len(again) >= len(first)


@pytest.mark.parametrize("budget", [0, 1, 20])
def test_prompts_keep_to_the_budget(budget: int) -> None:
    seen = view()
    known = one(seen)
    asked = len(seen.asked)
    config = dataclasses.replace(CONFIG, family=FamilyConfig(max_prompts=budget))
    found = with_families(seen, known, config, LOOSE)
    assert len(seen.asked) - asked == budget
    assert len(found) <= 1 + budget


def test_the_nearest_bricks_come_first() -> None:
    seen = view()
    config = dataclasses.replace(CONFIG, family=FamilyConfig(max_prompts=6))
    known = one(seen)
    asked = len(seen.asked)
    with_families(seen, known, config, LOOSE)
    middle = np.array(bricks()[6, 3].centroid.coords[0])
    assert np.hypot(*(np.array(seen.asked[asked:]) - middle).T).max() < 40


def test_prompts_stay_where_they_are_wanted() -> None:
    seen = view()
    where = np.zeros((256, 256), bool)
    where[:128] = True
    known = one(seen)
    asked = len(seen.asked)
    with_families(seen, known, CONFIG, LOOSE, where)
    assert max(y for _, y in seen.asked[asked:]) < 130


def test_masks_of_another_size_do_not_belong() -> None:
    seen = view()
    seen.regions[:] = [
        region if not region.prompt_only else dataclasses.replace(region, shape=region.shape.buffer(3))
        for region in seen.regions
    ]
    seen.__post_init__()
    assert len(with_families(seen, one(seen), CONFIG, LOOSE)) == 1


def test_what_does_not_repeat_has_no_family() -> None:
    seen = view(blank())
    known = one(seen)
    asked = len(seen.asked)
    assert with_families(seen, known, CONFIG, LOOSE) is known
    assert len(seen.asked) == asked


def test_the_same_bytes_twice() -> None:
    first, second = (with_families(seen, one(seen), CONFIG, LOOSE) for seen in (view(), view()))
    assert np.array_equal(first.logits, second.logits)
    assert np.array_equal(first.prompt, second.prompt)


@pytest.mark.parametrize("tries", [1, 3, 24])
def test_how_many_regions_are_correlated_at_a_time_changes_nothing(monkeypatch: pytest.MonkeyPatch, tries: int) -> None:
    """Every third brick is known: members of a family that the first of them finds."""
    config = dataclasses.replace(CONFIG, family=FamilyConfig(max_prompts=40, max_seeds=tries))
    plain = PaintedView(wall(), [Region(shape) for shape in bricks().values()])
    centres = np.array([shape.centroid.coords[0] for shape in bricks().values()])
    known = plain.predict(Prompts.at(centres), LOOSE)[np.arange(0, len(centres), 3)]
    found = list[MaskPredictions]()
    for seeds in (1, 4, 100):
        monkeypatch.setattr("zpm2.segment.family.SEEDS", seeds)
        found.append(with_families(view(), known, config, LOOSE))
    assert len(found[0]) > len(known) + 20
    for other in found[1:]:
        assert np.array_equal(found[0].logits, other.logits)
        assert np.array_equal(found[0].prompt, other.prompt)


@pytest.mark.parametrize("size", [(9, 14), (30, 21)])
def test_correlation_equals_that_of_all_channels_at_once(size: tuple[int, int]) -> None:
    """The reference: OpenCV's, which takes longer, and each place by itself."""
    rng = np.random.default_rng(3)
    rgb = cv2.GaussianBlur(rng.integers(0, 256, (60, 80, 3), np.uint8), (0, 0), 2)
    rgb[:25, 40:] = 90
    low = np.array([7, 5])
    found = family._Photograph.of(rgb).correlation(low, low + size)
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)
    part = lab[low[1] : low[1] + size[1], low[0] : low[0] + size[0]]
    reference = cv2.matchTemplate(lab, part, cv2.TM_CCOEFF_NORMED)
    flat = np.zeros(reference.shape, bool)
    flat[: max(0, 25 - size[1] + 1), 40:] = True
    np.testing.assert_allclose(found[~flat], reference[~flat], atol=2e-3)
    assert not found[flat].any()  # the reference divides nothing by nothing there
    for y, x in ((0, 0), (20, 30), (5, 7)):
        one, other = ((p - p.mean((0, 1))).ravel() for p in (part, lab[y : y + size[1], x : x + size[0]].astype(float)))
        assert found[y, x] == pytest.approx(one @ other / np.sqrt((one @ one) * (other @ other)), abs=1e-4)


def test_elements_hold_one_of_the_pixels() -> None:
    seen = view()
    holding = np.zeros(seen.size, bool)
    holding[:, :100] = True
    found = with_families(seen, one(seen), CONFIG, LOOSE, holding=holding)
    x = np.array([np.flatnonzero(bits.any(0)).min() for bits in found.bits[1:]])
    assert len(found) > 30
    assert (x < 100).all()
