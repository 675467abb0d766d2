"""Segment everything on scenes whose regions are known."""

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from painted import PaintedView, Region, blank

from zpm2.config import SegmentConfig
from zpm2.model import Image
from zpm2.segment.automatic import automatic_masks, grid, without_duplicates
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts

FULL = SegmentConfig(quality="full", grid=16, min_area=30.0)
LEVELS = [dataclasses.replace(FULL, quality=quality) for quality in ("fast", "balanced", "full")]


def scene() -> list[Region]:
    """Whole, part and subpart; a region in the hole of another; a thin one beside a large one; a small one alone."""
    ring = shapely.box(140, 20, 240, 120).difference(shapely.box(170, 50, 210, 90))
    shapes = [
        shapely.box(10, 10, 130, 130),
        shapely.box(20, 20, 90, 90),
        shapely.box(30, 30, 60, 60),
        ring,
        shapely.box(172, 52, 208, 88),
        shapely.box(10, 150, 250, 200),
        shapely.box(10, 201, 250, 219),
        shapely.box(120, 225, 138, 250),
    ]
    return [Region(shape, score=0.9 + 0.01 * k) for k, shape in enumerate(shapes)]


def painted(shapes: list[shapely.Polygon]) -> Image:
    """Bright shapes on grey, 256 x 256 px."""
    pixels = np.full((256, 256, 3), 90, np.uint8)
    for shape in shapes:
        x0, y0, x1, y1 = map(int, shape.bounds)
        pixels[y0:y1, x0:x1] = 200
    return Image(pixels)


def signature(predictions: MaskPredictions) -> set[bytes]:
    return {bits.tobytes() for bits in predictions.bits}


@pytest.mark.parametrize("n", [1, 2, 3, 5, 24, 32])
def test_the_grid_holds_every_cell_once(n: int) -> None:
    points = grid(n, (120, 200))
    expected = {((i + 0.5) * 200 / n, (j + 0.5) * 120 / n) for i in range(n) for j in range(n)}
    assert len(points) == n * n
    assert {(float(x), float(y)) for x, y in np.round(points, 9)} == {(round(x, 9), round(y, 9)) for x, y in expected}


@given(st.integers(1, 5), st.integers(0, 5))
def test_a_first_part_of_the_grid_is_a_coarser_grid(k: int, coarser: int) -> None:
    n, m = 2**k, 2 ** max(k - coarser, 0)
    first = grid(n, (n, n))[: m * m]
    cells = {(int(x) // (n // m), int(y) // (n // m)) for x, y in first}
    assert len(cells) == m * m  # one point in each of the m x m cells


def test_full_asks_every_point_once_and_finds_what_brute_force_finds() -> None:
    view = PaintedView(blank(), scene())
    found = automatic_masks(view, FULL)
    assert len(view.asked) == len(set(view.asked)) == FULL.grid**2
    thresholds = MaskThresholds(FULL.min_predicted_iou, FULL.min_stability)
    predictions = PaintedView(blank(), scene()).predict(Prompts.at(grid(FULL.grid, (256, 256))), thresholds)
    assert signature(found) == signature(predictions)
    assert (np.diff(found.score) <= 0).all()


@pytest.mark.parametrize("config", LEVELS, ids=lambda c: c.quality)
def test_only_what_lies_inside_another_region_can_be_lost(config: SegmentConfig) -> None:
    view, inside_another = PaintedView(blank(), scene()), {1, 2}  # the part and the subpart of the first
    found = signature(automatic_masks(view, config))
    lost = {k for k, bits in enumerate(view.bits) if bits.tobytes() not in found}
    assert lost <= (set() if config.quality == "full" else inside_another)
    assert len(found) == len(view.regions) - len(lost)


@pytest.mark.parametrize("config", LEVELS, ids=lambda c: c.quality)
def test_whole_part_and_subpart_come_with_one_prompt(config: SegmentConfig) -> None:
    shapes = [shapely.box(10, 10, 240, 240), shapely.box(12, 12, 200, 200), shapely.box(14, 14, 160, 160)]
    view = PaintedView(blank(), [Region(shape) for shape in shapes])
    assert len(automatic_masks(view, config)) == 3


def test_faster_levels_ask_less() -> None:
    counts = []
    for config in LEVELS:
        view = PaintedView(blank(), scene())
        automatic_masks(view, dataclasses.replace(config, grid=32))
        assert len(view.asked) == len(set(view.asked))
        counts.append(len(view.asked))
    assert counts == sorted(set(counts))
    assert counts[0] < 0.7 * counts[-1]


def test_an_image_that_never_answers_is_asked_everywhere_by_the_full_grid_only() -> None:
    for config, most in zip(LEVELS, (1 / 64 + 1 / 6 + 1 / 4, 1 / 64 + 1 / 3 + 1 / 2, 1.0), strict=True):
        view = PaintedView(blank(200, 120), [])
        shares: list[float] = []
        assert len(automatic_masks(view, config, progress=shares.append)) == 0
        assert 0.9 * most <= len(view.asked) / config.grid**2 <= 1.01 * most
        assert len(view.asked) == len(set(view.asked))
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


@pytest.mark.parametrize("config", LEVELS, ids=lambda c: c.quality)
def test_nothing_is_asked_where_there_is_no_data(config: SegmentConfig) -> None:
    valid = np.zeros((256, 256), bool)
    valid[:, 200:] = True
    view = PaintedView(Image(blank().rgb, valid=valid), [])
    automatic_masks(view, config)
    assert view.asked
    assert min(x for x, _ in view.asked) >= 200


@pytest.mark.parametrize("config", LEVELS[:2], ids=lambda c: c.quality)
def test_what_stands_out_is_found_in_the_midst_of_a_large_region(config: SegmentConfig) -> None:
    """A field with small things in it, none at a point of the grid: the field covers them all."""
    config = dataclasses.replace(config, grid=8)
    x, y = np.meshgrid(np.arange(22, 250, 32), np.arange(22, 250, 32))
    things = [shapely.box(a, b, a + 7, b + 7) for a, b in zip(x.ravel(), y.ravel(), strict=True)][:9]
    assert not any(shapely.contains_xy(thing, *grid(8, (256, 256)).T).any() for thing in things)
    regions = [Region(shapely.box(0, 0, 256, 256), 0.99), *(Region(thing) for thing in things)]
    view = PaintedView(painted(things), regions, batch=2)
    found = signature(automatic_masks(view, dataclasses.replace(config, max_area=1.0)))
    assert found == {bits.tobytes() for bits in view.bits}
    full = PaintedView(painted(things), regions)
    assert len(automatic_masks(full, dataclasses.replace(config, quality="full", max_area=1.0))) == 1


@pytest.mark.parametrize("config", LEVELS[:2], ids=lambda c: c.quality)
def test_known_regions_are_not_asked_about_and_come_first(config: SegmentConfig) -> None:
    whole = shapely.box(0, 0, 256, 128)
    known = PaintedView(blank(), [Region(whole, score=0.5)])
    answer = known.predict(Prompts.at(np.array([[40.0, 40.0]])), MaskThresholds(0.0, 0.0))
    view = PaintedView(blank(), [Region(whole.buffer(-1), score=0.99), Region(shapely.box(20, 150, 60, 200))])
    found = automatic_masks(view, config, known=answer)
    assert found.score[0] == 0.5  # and the better-scored double of it is gone
    assert len(found) == 2
    deep = [y for _, y in view.asked if y < 120]
    assert len(deep) < config.grid**2 / 4


@pytest.mark.parametrize("config", LEVELS, ids=lambda c: c.quality)
def test_two_runs_are_the_same(config: SegmentConfig) -> None:
    first, second = (automatic_masks(PaintedView(blank(), scene()), config) for _ in range(2))
    assert np.array_equal(first.logits, second.logits)
    assert np.array_equal(first.score, second.score)


@pytest.mark.parametrize("config", LEVELS)
@pytest.mark.parametrize("chosen", [1, 4, 16])
def test_how_many_prompts_a_device_takes_at_a_time_changes_nothing(config: SegmentConfig, chosen: int) -> None:
    """Those that are asked ahead cost time only."""
    config = dataclasses.replace(config, prompts=dataclasses.replace(config.prompts, chosen=chosen))
    found, asked = list[MaskPredictions](), list[int]()
    for batch in (1, 4, 16, 300):
        view = PaintedView(painted([region.shape for region in scene()]), scene(), batch)
        found.append(automatic_masks(view, config))
        asked.append(len(view.asked))
        assert len(set(view.asked)) == len(view.asked)
    for other in found[1:]:
        assert np.array_equal(found[0].logits, other.logits)
        assert np.array_equal(found[0].score, other.score)
    assert asked[0] == asked[-1] if config.quality == "full" else asked[0] < asked[-1]


def test_too_small_and_too_large_regions_are_none() -> None:
    view = PaintedView(blank(), [Region(shapely.box(100, 100, 104, 104)), Region(shapely.box(0, 0, 256, 256))])
    assert len(automatic_masks(view, dataclasses.replace(FULL, grid=64, min_area=60.0))) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_distinct_equals_a_plain_reading(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    corner, size = rng.integers(0, 150, (n, 2)), rng.integers(20, 100, (n, 2))
    logits = np.full((n, 256, 256), -5, np.float16)
    for k in range(n):
        (x, y), (w, h) = corner[k], size[k]
        logits[k, y : y + h, x : x + w] = 5
    rank = rng.permutation(n).astype(float)
    predictions = MaskPredictions(np.arange(n), np.ones(n, np.float32), np.ones(n, np.float32), logits)
    view = PaintedView(blank(), [])
    kept: list[int] = []
    for i in np.argsort(-rank):
        overlaps = [(logits[i] > 0) & (logits[k] > 0) for k in kept]
        unions = [(logits[i] > 0) | (logits[k] > 0) for k in kept]
        if all(a.sum() <= FULL.nms_iou * b.sum() for a, b in zip(overlaps, unions, strict=True)):
            kept.append(int(i))
    assert list(without_duplicates([predictions], rank, FULL, view).prompt) == kept
