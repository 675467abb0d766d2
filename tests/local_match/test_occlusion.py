"""A pole in front of a wall: it stands beside a panel of the wall in both photographs, and hides a part of it in the
right one, where the wall has moved by 10 px and the pole by 40."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapes import arrays, square

from zpm2.global_match import Candidates
from zpm2.local_match.occlusion import unhidden

NONE = Candidates(np.zeros(0, np.int64), np.zeros(0, np.int64))
MATCHED = Candidates.of(np.array([1]), np.array([1]))
PAIR = Candidates.of(np.array([0]), np.array([0]))


def moved(dx):
    return np.array([[[1.0, 0, dx], [0, 1, 0], [0, 0, 1]]])


def compared(left, right, matched=MATCHED, dx=10.0):
    """What is compared of the first left and right square, where the second ones are matched."""
    sides = arrays([square(*s) for s in left]), arrays([square(*s) for s in right])
    warped = shapely.transform(sides[0].shapes[:1], lambda xy: xy + np.array([dx, 0]))
    return unhidden(warped, sides[1].shapes[:1], PAIR, moved(dx), sides, matched, 0.1)


def test_a_pole_hides_a_part_of_the_wall_in_the_right_photograph():
    own, other = compared([(50, 0, 100, 100), (30, 0, 50, 100)], [(90, 0, 110, 100), (70, 0, 90, 100)])
    assert shapely.equals(own[0], shapely.box(90, 0, 110, 100) | shapely.box(60, 0, 70, 100))
    assert shapely.equals(other[0], shapely.box(90, 0, 110, 100))


def test_and_in_the_left_one():
    """The panel goes on behind the pole, which the right photograph shows elsewhere."""
    own, other = compared([(50, 0, 100, 100), (30, 0, 50, 100)], [(40, 0, 110, 100), (150, 0, 170, 100)])
    assert shapely.equals(own[0], shapely.box(60, 0, 110, 100))
    assert shapely.equals(other[0], shapely.box(60, 0, 110, 100))


def test_what_moves_as_the_pair_does_hides_nothing():
    own, other = compared([(50, 0, 100, 100), (30, 0, 50, 100)], [(60, 0, 110, 100), (40, 0, 60, 100)])
    assert own[0].area == pytest.approx(5000)
    assert other[0].area == pytest.approx(5000)


@pytest.mark.parametrize("side", [0, 1])
def test_a_part_of_a_polygon_does_not_hide_it(side):
    """A window moves with its wall; that its partner lies elsewhere says that one of both matches is wrong."""
    inside, beyond = (70, 20, 80, 60), (200, 0, 210, 40)
    windows = [inside, beyond] if side == 0 else [beyond, inside]
    own, other = compared([(50, 0, 100, 100), windows[0]], [(60, 0, 110, 100), windows[1]])
    assert own[0].area == other[0].area == pytest.approx(5000)


def test_without_matches_nothing_is_hidden():
    own, other = compared([(50, 0, 100, 100), (30, 0, 50, 100)], [(90, 0, 110, 100), (70, 0, 90, 100)], NONE)
    assert own[0].area == pytest.approx(5000)
    assert other[0].area == pytest.approx(2000)


squares = st.builds(lambda x, y, w, h: (x, y, x + w, y + h), *[st.integers(0, 60)] * 2, *[st.integers(1, 40)] * 2)


@given(st.lists(squares, min_size=2, max_size=5), st.lists(squares, min_size=5, max_size=5), st.integers(-30, 30))
def test_as_one_pair_after_the_other(left, right, dx):
    """The reference: every match is looked at, and its pixels are taken away one after the other."""
    right = right[: len(left)]
    sides = arrays([square(*s) for s in left]), arrays([square(*s) for s in right])
    rows = np.arange(1, len(left))
    own, other = compared(left, right, Candidates(rows, rows), dx)
    shift = [float(dx), 0.0]
    expected = [shapely.transform(sides[0].shapes[0], lambda xy: xy + shift), sides[1].shapes[0]]
    x0, y0, x1, y1 = left[0]
    around = shapely.box(2 * x0 - x1, 2 * y0 - y1, 2 * x1 - x0, 2 * y1 - y0)
    for row in rows:
        ours = [side.shapes[0] for side in sides]
        theirs = [side.shapes[row] for side in sides]
        if all(a.intersection(b).area <= 0.1 * min(a.area, b.area) for a, b in zip(ours, theirs, strict=True)):
            expected[0] = expected[0] - theirs[1]
            if around.intersects(theirs[0]):
                expected[1] = expected[1] - shapely.transform(theirs[0], lambda xy: xy + shift)
    assert [own[0].area, other[0].area] == pytest.approx([each.area for each in expected])
