"""Why polygons have no partner, in scenes of a few squares in which the right photograph is the left one moved."""

import numpy as np
import pytest
import shapely
from shapes import arrays, square

from zpm2.config import LocalConfig
from zpm2.local_match.unmatched import REASONS, unmatched_reasons, visible_share
from zpm2.model import PolygonArrays
from zpm2.polygons.warp import WarpedPolygons

SIZE = 400, 300  # px of the right photograph
SHIFT = np.array([50.0, 0.0])  # left px to right px
MIN_OVERLAP = 0.3


def warped(rings, shift=SHIFT):
    """Where the squares should be; None for one of which nothing says it."""
    shapes = [shapely.Polygon() if ring is None else shapely.Polygon(ring + shift) for ring in rings]
    array = np.empty(len(rings), object)
    array[:] = shapes
    return WarpedPolygons(np.tile(np.eye(3), (len(rings), 1, 1)), array, np.zeros(len(rings), int))


def why(left, right, partner, known=None, valid=None, min_overlap=MIN_OVERLAP):
    """Reasons by row of the left rings."""
    there = warped(left if known is None else known)
    visible = visible_share(there, SIZE, valid)
    given = arrays(left), arrays(right) if right else PolygonArrays([])
    found = unmatched_reasons(*given, np.array(partner, np.int64), there, visible, LocalConfig(min_overlap=min_overlap))
    return {id - 100: reason for id, reason in found.items()}


A, B = square(100, 100, 160, 160), square(20, 200, 80, 260)


def test_matched_polygons_need_no_reason():
    assert why([A, B], [A + SHIFT, B + SHIFT], [0, 1]) == {}
    assert why([A, B], [A + SHIFT, B + SHIFT], [0, -1]).keys() == {1}


@pytest.mark.parametrize(("x", "outside"), [(300, False), (315, False), (325, True), (380, True)])
def test_outside_overlap_is_less_than_half_in_the_photograph(x, outside):
    unmatched = square(x, 10, x + 60, 60)  # of which 350 - x px are seen
    assert why([unmatched], [A], [-1]) == {0: "outside overlap" if outside else "no candidate"}


def test_outside_overlap_is_where_there_are_no_data():
    valid = np.ones((30, 40), bool)  # a tenth of the resolution
    valid[:, 15:22] = False
    assert why([A], [], [-1], valid=valid) == {0: "outside overlap"}
    assert why([B], [], [-1], valid=valid) == {0: "no candidate"}


def test_occluded_is_covered_by_what_lies_elsewhere():
    """The tower of A stands before B's place on the right."""
    tower = square(70, 190, 150, 270)
    assert why([A, B], [tower], [0, -1]) == {1: "occluded"}
    part = square(40, 190, 95, 300)  # covers 25 of 60 px
    assert why([A, B], [part], [0, -1]) == {1: "no candidate"}


def test_occluded_by_several_together():
    towers = [square(40, 190, 98, 300), square(98, 190, 150, 300)]  # each covers less than half
    assert why([A, A + 100, B], towers, [0, 1, -1]) == {2: "occluded"}
    twice = [square(40, 190, 95, 300)] * 2  # the same 25 of 60 px, which count once
    assert why([A, A + 100, B], twice, [0, 1, -1]) == {2: "no candidate"}


def test_what_contains_it_does_not_hide_it():
    """The yard around B is matched, and its partner lies over B's place as it should."""
    yard = square(0, 180, 100, 280)
    assert why([yard, B], [yard + SHIFT], [0, -1]) == {1: "rejected"}
    wide = square(-40, 100, 240, 300)
    assert why([wide, B], [wide + SHIFT], [0, -1]) == {1: "no candidate"}


def test_unmatched_ones_hide_nothing():
    tower = square(70, 190, 200, 300)
    assert why([A, B], [A + SHIFT, tower], [0, -1]) == {1: "no candidate"}


def test_rejected_is_a_candidate_that_was_not_taken():
    assert why([B], [B + SHIFT], [-1]) == {0: "rejected"}
    other = B + SHIFT + [30, 0]  # IoU 1 / 3
    assert why([B], [other], [-1]) == {0: "rejected"}
    assert why([B], [other], [-1], min_overlap=0.4) == {0: "no candidate"}


def test_rejected_is_one_whose_candidate_has_a_better_partner():
    """B and a copy of it: neighbours that overlap do not hide each other."""
    assert why([B, B + np.array([4, 0])], [B + SHIFT], [0, -1]) == {1: "rejected"}


def test_no_candidate_is_the_rest():
    assert why([B], [], [-1]) == {0: "no candidate"}
    assert why([B], [A], [-1]) == {0: "no candidate"}
    assert why([B], [B + SHIFT], [-1], known=[None]) == {0: "no candidate"}  # nobody knows where it should be
    assert why([], [A], []) == {}


def test_the_first_reason_that_holds():
    out = square(330, 100, 400, 160)
    assert why([A, out], [out + SHIFT], [0, -1])[1] == "outside overlap"  # though it is covered, and a candidate
    tower = B + SHIFT
    assert why([A, B], [tower], [0, -1]) == {1: "occluded"}  # though it overlaps


def test_all_reasons_in_one_scene():
    out, hidden, alone, like = square(380, 0, 440, 60), B, square(200, 20, 240, 60), square(200, 200, 240, 240)
    right = [square(70, 190, 150, 270), like + SHIFT]
    found = why([A, out, hidden, alone, like], right, [0, -1, -1, -1, -1])
    assert found == {1: "outside overlap", 2: "occluded", 3: "no candidate", 4: "rejected"}
    assert set(found.values()) == set(REASONS)


# --- visible


@pytest.mark.parametrize(
    ("ring", "share"),
    [
        (square(10, 10, 50, 50), 1.0),
        (square(-20, 10, 20, 50), 0.5),
        (square(390, 290, 410, 310), 0.25),
        (square(500, 0, 600, 50), 0.0),
        (square(-400, -300, 800, 600), 1 / 9),
    ],
)
def test_the_share_that_lies_in_the_photograph(ring, share):
    there = warped([ring], 0.0)
    assert visible_share(there, SIZE) == pytest.approx([share])
    assert visible_share(there, SIZE, np.ones((30, 40), bool)) == pytest.approx([share])
    assert visible_share(there, SIZE, np.zeros((30, 40), bool)) == pytest.approx([0.0])


def test_an_empty_shape_is_not_visible():
    there = warped([None, A], 0.0)
    assert visible_share(there, SIZE).tolist() == [0.0, 1.0]
    assert visible_share(there, SIZE, np.ones((300, 400), bool)).tolist() == [0.0, 1.0]
    assert visible_share(warped([]), SIZE).shape == (0,)
    assert visible_share(warped([]), SIZE, np.ones((300, 400), bool)).shape == (0,)


def test_an_outline_along_the_end_of_the_data_is_no_gap():
    valid = np.ones((300, 400), bool)
    valid[:, :200] = False
    assert visible_share(warped([square(199, 50, 300, 250)], 0.0), SIZE, valid) == pytest.approx([1.0])


@pytest.mark.parametrize("resolution", [(300, 400), (75, 100), (30, 41)])
def test_data_in_a_part_of_it(resolution):
    valid = np.ones(resolution, bool)
    valid[:, : resolution[1] // 2] = False
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    disc = 60 * np.c_[np.cos(angle), np.sin(angle)]
    there = warped([disc + np.array([x, 150]) for x in (100, 200, 300)], 0.0)
    share = visible_share(there, SIZE, valid)
    assert share[0] == 0
    assert 0.35 < share[1] < 0.65
    assert share[2] == pytest.approx(1.0)
