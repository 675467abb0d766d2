import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import square
from test_content import image, shapes, textured

from zpm2.config import VerifyConfig
from zpm2.verify.flow import agreement

CONFIG = VerifyConfig()
RING = np.array(square(120, 60, 180, 120), float)


def ring_at(x, y=0.0):
    return RING + np.array([x, y])


def moved(gray, x, y):
    return np.roll(gray, (y, x), axis=(0, 1))


def agreed(left, right, off=(0.0, 0.0), ring=RING, target=RING):
    """Of a left polygon that points put `off` px from where it belongs, and its partner."""
    maps = np.array([[[1, 0, off[0]], [0, 1, off[1]], [0, 0, 1]]], float)
    return agreement((image(left), image(right)), shapes(ring + off), shapes(target), maps, CONFIG, 6)[0]


@settings(max_examples=20, deadline=None)
@given(st.integers(-4, 4), st.integers(-4, 4))
def test_points_that_are_a_few_px_off_are_corrected(x, y):
    gray = textured(0)
    assert agreed(gray, moved(gray, x, y), target=ring_at(x, y)) > 0.9


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5])
def test_it_is_the_overlap_where_the_insides_agree(share):
    """The outline of the partner is beside what it should show, and looks the same: its inside tells."""
    gray, away = textured(1), share * 60
    assert agreed(gray, gray, target=ring_at(away)) == pytest.approx((1 - share) / (1 + share), abs=0.08)


def test_insides_that_differ_agree_less():
    assert agreed(textured(2), textured(3)) < agreed(textured(2), textured(2)) - 0.2


def test_light_and_contrast_drop_out():
    gray = textured(4)
    lit = 0.5 * gray + np.linspace(0, 60, gray.shape[1])
    assert agreed(gray, lit) > 0.9


def test_without_texture_the_points_decide():
    flat = np.full((200, 300), 120.0)
    overlap = shapely.Polygon(RING).intersection(shapely.Polygon(ring_at(15))).area / (75 * 60)
    assert agreed(flat, flat, target=ring_at(15)) == pytest.approx(overlap, abs=0.05)


def test_what_no_photograph_shows_counts_nothing():
    gray = textured(5)
    assert agreed(gray, gray, off=(-1000.0, 0.0)) == 0.0
    images, nowhere = (image(gray), image(gray)), np.array([shapely.Polygon()], object)
    assert agreement(images, nowhere, shapes(RING), np.eye(3)[None], CONFIG, 6).tolist() == [0.0]
    assert agreement(images, shapes(), shapes(), np.zeros((0, 3, 3)), CONFIG, 6).shape == (0,)


def test_the_number_of_threads_does_not_count():
    gray, other = textured(6), moved(textured(6), 3, 1)
    threads, found = cv2.getNumThreads(), []
    try:
        for number in (1, 2, 3):
            cv2.setNumThreads(number)
            found.append(agreed(gray, other, off=(1.0, 0.0)))
    finally:
        cv2.setNumThreads(threads)
    assert len(set(found)) == 1
