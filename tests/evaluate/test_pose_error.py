import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.evaluate.pose_error import pose_auc, pose_error


def turn(degrees, axis=(0.0, 0.0, 1.0)):
    axis = np.array(axis) / np.linalg.norm(axis)
    return cv2.Rodrigues(np.radians(degrees) * axis)[0]


def pose(rotation, translation):
    return np.c_[rotation, translation]


@given(st.floats(0, 180), st.floats(0, 180), st.floats(0.1, 50))
def test_angles_are_those_that_were_put_in(rotation, translation, length):
    base = turn(40, (1, 2, 3))
    truth = np.vstack([pose(base, [2.0, 0, 0]), [0, 0, 0, 1]])
    off = turn(translation) @ [length, 0, 0]
    found = pose_error(base @ turn(rotation, (1, -1, 0.5)), off, truth)
    assert found == pytest.approx((rotation, min(translation, 180 - translation)), abs=1e-5)


def test_tiny_angles_do_not_vanish():
    found = pose_error(turn(1e-7), turn(2e-7) @ [1.0, 0, 0], pose(np.eye(3), [1.0, 0, 0]))
    assert found == pytest.approx((1e-7, 2e-7), rel=1e-6)


def test_the_sign_of_the_translation_is_open_and_its_shape_free():
    truth = pose(np.eye(3), [0, 0, 1.0])
    assert pose_error(np.eye(3), np.array([[0], [0], [-3.0]]), truth) == (0.0, 0.0)


def test_cameras_that_did_not_move_and_estimates_that_do_not_exist():
    still, moved = pose(np.eye(3), np.zeros(3)), pose(np.eye(3), [1.0, 0, 0])
    assert pose_error(turn(3), np.array([1.0, 0, 0]), still) == (pytest.approx(3.0), 0.0)
    failed = (float("inf"), float("inf"))
    assert pose_error(np.full((3, 3), np.nan), np.ones(3), moved) == failed
    assert pose_error(np.eye(3), np.array([np.nan, 0, 0]), moved) == failed
    assert pose_error(np.eye(3), np.zeros(3), moved) == failed
    assert pose_error(turn(3), None, still) == (pytest.approx(3.0), 0.0)
    assert pose_error(np.eye(3), None, moved) == failed


def test_auc_by_hand():
    # one pair, error 2: a straight line up to (2, 1), then flat: (2 / 2 + 3) / 5
    assert pose_auc([2.0], (5,)) == pytest.approx((0.8,))
    # (0, 0), (2, 1/2), (4, 1), flat to 5 and on; at 3 the curve is flat from (2, 1/2) on
    assert pose_auc([4.0, 2.0], (5, 10, 3)) == pytest.approx((3 / 5, 8 / 10, 1 / 3))
    # failures stay above every threshold
    assert pose_auc([2.0, np.inf, np.nan, 60.0], (5,)) == pytest.approx(((0.25 + 3 * 0.25) / 5,))
    assert pose_auc([0.0, 0.0]) == (1.0, 1.0, 1.0)
    assert pose_auc([np.inf]) == (0.0, 0.0, 0.0)
    assert pose_auc([5.0], (5,)) == (0.0,)  # an error at the threshold is not below it
    assert pose_auc([]) == (0.0, 0.0, 0.0)


def test_of_two_angles_the_larger_counts():
    assert pose_auc([(1.0, 4.0), (2.0, 0.0)]) == pose_auc([4.0, 2.0])
    assert pose_auc([(1.0, np.nan)]) == pose_auc([np.inf])
    assert pose_auc(np.zeros((0, 2))) == (0.0, 0.0, 0.0)


@given(st.lists(st.floats(0, 40), min_size=1, max_size=20))
def test_auc_is_that_of_the_published_evaluation(errors):
    """SuperGlue's pose_auc, written down as its text says: sort, cumulate, cut, trapezoids."""
    ranked = sorted(errors)
    for threshold, ours in zip((5, 10, 20), pose_auc(errors), strict=True):
        area, x, y = 0.0, 0.0, 0.0
        for k, error in enumerate(ranked, 1):
            if error >= threshold:
                break
            area += (error - x) * (y + k / len(ranked)) / 2
            x, y = error, k / len(ranked)
        assert ours == pytest.approx((area + (threshold - x) * y) / threshold)
        assert 0 <= ours <= 1
