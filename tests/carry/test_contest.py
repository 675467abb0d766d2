"""One assignment over all regions and places."""

import numpy as np
import pytest
import shapely

from zpm2.carry import contest
from zpm2.carry.asking import Answers
from zpm2.config import CarryConfig
from zpm2.segment.predictions import MaskPredictions

CONFIG = CarryConfig()


def answers(*boxes):
    """Answers of one region: (x0, y0, x1, y1, agreement) each, px of a decoded mask."""
    logits = np.full((len(boxes), 64, 64), -8, np.float16)
    for k, (x0, y0, x1, y1, _) in enumerate(boxes):
        logits[k, y0:y1, x0:x1] = 8
    ones = np.ones(len(boxes), np.float32)
    masks = MaskPredictions(np.zeros(len(boxes), np.int64), ones, ones, logits)
    agreement = np.array([box[4] for box in boxes], float)
    return Answers(masks, agreement, agreement, np.zeros(len(boxes), bool))


def decided(answered, given=None):
    """The choices of regions that lie apart on the left, or as `given`."""
    apart = [shapely.box(10 * k, 0, 10 * k + 5, 5) for k in range(len(answered))]
    return contest.decide(answered, np.array(given or apart, object), CONFIG)


A, B = (4, 4, 20, 20), (40, 40, 60, 60)
NOWHERE = np.array([shapely.Polygon()] * 2, object)


def test_the_sum_of_agreements_decides_and_not_the_order():
    first = answers((*A, 0.8), (*B, 0.75))
    second = answers((*A, 0.7))
    choices = decided([first, second])
    assert [choice.row for choice in choices] == [1, 0]  # 0.75 + 0.7 is more than 0.8 alone
    assert choices[0].lost == 1
    assert choices[0].others == (0,)


def test_the_loser_of_its_only_place_learns_to_whom():
    choices = decided([answers((*A, 0.8)), answers((*A, 0.6))])
    assert [choice.row for choice in choices] == [0, None]
    assert choices[1].lost == 0


def test_regions_that_are_one_place_on_the_left_share_it_on_the_right():
    given = [shapely.box(0, 0, 10, 10), shapely.box(0, 0, 10, 9), shapely.box(0, 0, 10, 4)]
    choices = decided([answers((*A, 0.8)), answers((*A, 0.7), (*B, 0.2)), answers((*A, 0.6))], given)
    assert [choice.row for choice in choices] == [0, 0, None]
    assert [choice.lost for choice in choices] == [None, None, 0]


def test_answers_below_the_limit_do_not_count():
    (choice,) = decided([answers((*A, CONFIG.min_agreement - 0.01))])
    assert choice.row is None
    assert choice.others == ()


def test_no_answers():
    nothing = Answers.none((64, 64))
    assert [c.row for c in decided([nothing, nothing])] == [None, None]
    assert decided([]) == []


def test_masks_that_overlap_are_one_place():
    shifted = (5, 4, 21, 20)
    choices = decided([answers((*A, 0.8)), answers((*shifted, 0.7), (*B, 0.4))])
    assert [choice.row for choice in choices] == [0, 1]


def test_regions_that_overlapped_may_overlap():
    given = np.array([shapely.box(0, 0, 10, 10), shapely.box(2, 2, 8, 8)], object)
    found = contest.disjoint(given, given, NOWHERE, np.array([0.5, 0.9]), CONFIG)
    assert [shape.area for shape in found] == [100, 36]


def test_what_is_contested_goes_to_the_region_whose_place_it_is_in():
    given = np.array([shapely.box(0, 0, 10, 10), shapely.box(10, 0, 20, 10)], object)
    wide = np.array([shapely.box(0, 0, 18, 10), shapely.box(8, 0, 20, 10)], object)
    for agreement in ([0.9, 0.5], [0.5, 0.9]):
        found = contest.disjoint(wide, given, given, np.array(agreement), CONFIG)
        assert [shape.bounds for shape in found] == [(0, 0, 10, 10), (10, 0, 20, 10)]


def test_outlines_that_share_areas_and_lines_are_taken_apart():
    given = np.array([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)], object)
    comb = shapely.union_all([shapely.box(0, 0, 10, 10), shapely.box(10, 0, 12, 2), shapely.box(10, 6, 12, 8)])
    other = shapely.union_all([shapely.box(10, 3, 20, 10), shapely.box(9, 0, 20, 1)])
    found = contest.disjoint(np.array([comb, other], object), given, NOWHERE, np.array([0.9, 0.5]), CONFIG)
    assert found[0].equals(comb)
    assert found[1].area == pytest.approx(other.difference(comb).area)
    assert {shape.geom_type for shape in found} <= {"Polygon", "MultiPolygon"}
