"""What the browser sends is checked."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.app.export import region_of
from zpm2.app.prompt import MOST_POINTS, prompt_of, shape_from, share, side_of
from zpm2.errors import InputError
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, OUTSIDE

NUMBERS = st.floats(allow_nan=True) | st.integers() | st.booleans() | st.none() | st.text(max_size=3)
ANYTHING = st.recursive(
    NUMBERS,
    lambda inner: (
        st.lists(inner, max_size=5)
        | st.dictionaries(
            st.sampled_from(["points", "box", "size", "left", "right", "match", "accepted"]), inner, max_size=5
        )
    ),
    max_leaves=20,
)


def test_points_and_a_box() -> None:
    prompt = prompt_of({"points": [[1, 2, 1], [3, 4, 0], [5, 6, 1]], "box": [9, 8, 1, 2], "size": 2})
    asked = prompt.prompts(np.array([2.0, 1.0]))
    assert asked.labels.tolist() == [INSIDE, INSIDE, OUTSIDE, CORNER, OTHER_CORNER]
    assert asked.points.tolist() == [[[2, 2], [10, 6], [6, 4], [2, 2], [18, 8]]]
    assert prompt.size == 2


@pytest.mark.parametrize(
    ("prompt", "text"),
    [
        ({"points": [], "box": None}, "no point inside"),
        ({"points": [[1, 2, 0]]}, "no point inside"),
        ({"points": [], "box": [1, 1, 1, 9]}, "empty"),
        ({"points": [[math.nan, 1, 1]]}, "no number"),
        ({"points": [[1e300, 1, 1]]}, "no number"),
        ({"points": [[1, 1]]}, "cannot be used"),
        ({"points": [[1, 1, 1]] * (MOST_POINTS + 1)}, "at most"),
        ({"points": [[1, 1, 1]], "size": 1.5}, "size"),
        ({"points": [[1, 1, 1]], "box": [[0, 0], [1, 1]]}, "cannot be used"),
        ({}, "points"),
        (None, "no object"),
    ],
)
def test_a_wrong_prompt_is_one_line(prompt: object, text: str) -> None:
    with pytest.raises(InputError, match=text) as caught:
        prompt_of(prompt)
    assert "\n" not in str(caught.value)


@settings(max_examples=40)
@given(ANYTHING)
def test_anything_is_read_or_refused(value: object) -> None:
    for read in (prompt_of, shape_from, share, region_of):
        with contextlib.suppress(InputError):
            read(value)


def test_outlines() -> None:
    ring = [[0, 0], [10, 0], [10, 10], [0, 10]]
    assert shape_from([[ring, [[4, 4], [6, 4], [6, 6], [4, 6]]]]).area == 96
    assert shape_from([[ring], [[[20, 0], [30, 0], [30, 10]]]]).area == 150
    bow = shape_from([[[[0, 0], [10, 10], [10, 0], [0, 10]]]])  # its edges cross
    assert bow.is_valid
    for wrong in (
        [],
        [[]],
        [[ring[:2]]],
        [[[[0, 0], [5, 5], [9, 9]]]],
        [[[[0, 0], [math.inf, 0], [9, 9]]]],
        "x",
        7,
        None,
    ):
        with pytest.raises(InputError):
            shape_from(wrong)


def test_sides() -> None:
    assert [side_of({"side": name}) for name in ("left", "right")] == [0, 1]
    for wrong in ("", None, 0, [], "../left"):
        with pytest.raises(InputError):
            side_of({"side": wrong})
