from dataclasses import replace

import numpy as np
import pytest
from blobs import blobs, box, moved, result
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.errors import InputError
from zpm2.evaluate.ground_truth import from_disparity, mutual_best, overlap
from zpm2.evaluate.label_raster import rasterize_labels
from zpm2.evaluate.metrics import (
    area_coverage_ratio,
    area_overlap_ratio,
    correct_coverage,
    f1,
    match_rows,
    matching_area_score,
    precision,
    recall,
    score,
    score_centers,
    score_overlap,
    scores,
)
from zpm2.evaluate.pairs import DisparityTruth

SIZE = (120, 80)
FLAT = from_disparity(np.full((80, 120), 10.0), SIZE)  # 110 of 120 columns are seen by both


def pairs(*rows):
    return np.array(rows, int).reshape(-1, 2)


def test_counts_by_hand():
    assert precision(3, 4) == 0.75
    assert precision(0, 0) == 0
    assert recall(pairs((0, 1), (2, 2)), pairs((0, 1), (1, 0), (3, 3), (2, 0))) == 0.25
    assert recall(pairs((0, 0)), pairs()) == 0
    assert recall(pairs(), pairs((0, 0))) == 0
    assert f1(0.5, 1.0) == pytest.approx(2 / 3)
    assert f1(0.0, 0.0) == 0


def test_areas_by_hand():
    left = rasterize_labels([box(0, 0, 0, 10, 10), box(0, 5, 0, 15, 10), box(0, 40, 40, 60, 60)], *SIZE)
    right = rasterize_labels([box(0, 0, 0, 20, 10), box(0, 40, 40, 50, 50)], *SIZE)
    assert left.pixels.tolist() == [100, 100, 400]
    assert right.pixels.tolist() == [200, 100]
    scored, true = pairs((0, 0), (1, 1)), pairs((0, 0), (2, 1))
    assert matching_area_score(left, right, scored, true) == pytest.approx((100 / 550 + 300 / 300) / 2)
    assert matching_area_score(left, right, pairs(), true) == 0
    assert matching_area_score(left, right, pairs(), pairs()) == 0
    assert area_coverage_ratio(left, scored, true) == pytest.approx(200 / 500)
    assert area_coverage_ratio(left, pairs(), true) == 0
    assert area_coverage_ratio(left, pairs(), pairs()) == 0
    assert area_overlap_ratio(left, right, scored) == pytest.approx((150 + 300) / 2 / 9600)
    assert area_overlap_ratio(left, right, pairs()) == 0


def test_coverage_by_hand():
    left = [box(0, 20, 20, 60, 60), box(0, 30, 30, 50, 50), box(0, 80, 0, 100, 80)]
    right = [box(0, 10, 20, 50, 60), box(0, 20, 30, 40, 50), box(0, 90, 0, 110, 80)]
    overlaps = overlap(left, right, FLAT, SIZE, SIZE)
    assert overlaps.points == 110 * 80
    assert correct_coverage(overlaps, pairs((0, 0))) == pytest.approx(1600 / 8800)
    assert correct_coverage(overlaps, pairs((1, 1))) == pytest.approx(400 / 8800)
    assert correct_coverage(overlaps, pairs((0, 0), (1, 1))) == pytest.approx(1600 / 8800)  # nested: counted once
    assert correct_coverage(overlaps, pairs((0, 1), (1, 0))) == pytest.approx(400 / 8800)  # only where both are
    assert correct_coverage(overlaps, pairs((2, 2))) == 0
    assert correct_coverage(overlaps, pairs()) == 0


def test_a_result_by_hand():
    left = [box(0, 20, 20, 60, 60), box(0, 64, 4, 74, 14), box(0, 80, 0, 100, 80), box(0, 0, 0, 8, 70)]
    right = [box(0, 10, 20, 50, 60), box(0, 54, 4, 64, 14), box(0, 85, 0, 105, 80), box(0, 2, 70, 4, 72)]
    left, right = ([replace(p, id=10 * k + s) for k, p in enumerate(side)] for s, side in ((1, left), (2, right)))
    found = score(result(left, right, [(1, 2), (21, 22), (31, 32)], SIZE), FLAT, 0.5)
    expected = {"iou": 0.5, "left": 4, "right": 4, "scored": 2, "unscored": 1, "good": 1, "gt": 2, "points": 8800}
    expected |= {"P": 0.5, "R": 0.5, "F1": 0.5}
    expected["MAS"] = ((1600 / 3300) + (1600 / 3300)) / 2
    expected["ACR"] = 3200 / 1700
    expected["AOR"] = 3200 / 9600
    expected["CCR"], expected["CCR5"] = 1600 / 8800, 0.0  # 1,600 px are more than 5 % of the image
    assert found.to_dict() == pytest.approx(expected)
    assert list(found.to_dict()) == [*score(result([], [], [], SIZE), FLAT).to_dict()]


def test_small_polygons_count_for_ccr5():
    left, right = [box(0, 64, 4, 86, 24)], [box(0, 54, 4, 76, 24)]
    found = score(result(left, right, [(0, 0)], SIZE), FLAT)
    assert found.CCR5 == found.CCR == pytest.approx(440 / 8800)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_properties(seed):
    rng = np.random.default_rng(seed)
    left = blobs(rng, 10, SIZE)
    right = [moved(p, [-6 + rng.uniform(-3, 3), rng.uniform(-3, 3)], k) for k, p in enumerate(left)]
    points = from_disparity(rng.uniform(4, 8, (80, 120)), SIZE)
    overlaps = overlap(left, right, points, SIZE, SIZE)
    back = overlap(right, left, points.swapped(), SIZE, SIZE)
    order = rng.permutation(10)[:6]
    matches = np.stack([order, rng.permutation(order)], axis=1)
    last = None
    for t in (0.2, 0.4, 0.5, 0.8):
        there, here = score_overlap(overlaps, matches, t), score_overlap(back, matches[:, ::-1], t)
        for name in ("MAS", "P", "R", "F1", "AOR", "CCR", "gt", "good", "scored"):
            assert getattr(there, name) == pytest.approx(getattr(here, name))
        for name in ("P", "R", "F1", "MAS", "AOR", "CCR", "CCR5"):
            assert 0 <= getattr(there, name) <= 1
        assert there.CCR5 <= there.CCR
        if last is not None:
            for name in ("good", "gt", "P", "CCR", "CCR5"):
                assert getattr(there, name) <= getattr(last, name)
            assert there.ACR >= last.ACR
        last = there
        true = mutual_best(overlaps, t)
        if len(true):
            itself = score_overlap(overlaps, true, t)
            assert {itself.MAS, itself.P, itself.R, itself.F1, itself.ACR} == {1.0}


def test_the_tools_rules_for_nothing():
    nothing = score(result([], [], [], SIZE), FLAT).to_dict()
    assert {k: v for k, v in nothing.items() if v} == {"iou": 0.5, "points": 8800}
    one = [box(0, 20, 20, 60, 60)]
    for left, right in ((one, []), ([], one)):
        assert score(result(left, right, [], SIZE), FLAT).gt == 0
    unseen = score(result(one, one, [(0, 0)], SIZE), from_disparity(np.full((80, 120), np.nan), SIZE))
    assert (unseen.unscored, unseen.scored, unseen.points, unseen.CCR) == (1, 0, 0, 0)


def test_scores_at_several_thresholds_are_those_at_each(tmp_path):
    np.save(tmp_path / "d.npy", np.full((80, 120), 10.0))
    found = result([box(0, 20, 20, 60, 60)], [box(0, 14, 20, 54, 60)], [(0, 0)], SIZE)
    truth = DisparityTruth(tmp_path / "d.npy")
    several = scores(found, truth)
    assert [s.good for s in several] == [1, 1, 1]
    assert several == tuple(score(found, FLAT, t) for t in (0.4, 0.5, 0.8))
    assert score(found, FLAT, 0.85).good == 0


def test_score_by_the_papers_protocol():
    left = [replace(box(0, 20, 20, 60, 60), id=k) for k in (0,)] + [replace(box(0, 70, 10, 90, 30), id=1)]
    right = [replace(box(0, 12, 20, 52, 60), id=0), replace(box(0, 50, 10, 70, 30), id=1)]
    found = score_centers(result(left, right, [(0, 0), (1, 1)], SIZE), FLAT)
    assert (found.good, found.scored, found.gt, found.P, found.R) == (1, 2, 1, 0.5, 1.0)
    assert found.iou is None
    assert score_centers(result(left, right, [(0, 0)], SIZE), FLAT).MAS == 1.0


def test_matches_must_be_one_to_one_and_name_polygons():
    polygons = [replace(box(0, 20, 20, 60, 60), id=k) for k in (4, 9)]
    assert match_rows(polygons, polygons, result(polygons, polygons, [(9, 4)], SIZE).matches).tolist() == [[1, 0]]
    with pytest.raises(InputError, match="match 4 - 5 names"):
        score(result(polygons, polygons, [(4, 5)], SIZE), FLAT)
    for twice in ([(4, 4), (4, 9)], [(4, 9), (9, 9)]):
        with pytest.raises(InputError, match="one-to-one"):
            score(result(polygons, polygons, twice, SIZE), FLAT)
