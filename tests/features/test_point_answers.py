"""What point matchers of others return: what is harmless is put right, the rest is an error that names them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from zpm2.errors import PointMatcherError
from zpm2.features.answers import points_of, points_of_many
from zpm2.features.combined import CombinedMatcher
from zpm2.model import Image, PointMatches

IMAGE = Image(np.zeros((20, 30, 3), np.uint8))
POINTS = PointMatches(np.array([[1.5, 2], [4, 5]]), np.array([[2.5, 2], [5, 5]]), np.array([0.5, 1]))


@dataclass
class Says:
    """A matcher that returns, or raises, what it is told."""

    answer: Any
    name: str = "says"

    def match(self, left: Image, right: Image) -> PointMatches:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer  # type: ignore[no-any-return]

    def match_many(self, pairs: Any) -> list[PointMatches]:
        return [self.match(*pair) for pair in pairs[:2]]


@pytest.mark.parametrize("change", [lambda a: a.astype(">f8"), lambda a: a.astype("f4"), np.asfortranarray, list])
def test_any_array_of_numbers_becomes_one_kind(change: Any) -> None:
    odd = PointMatches(*(change(array) for array in (POINTS.left, POINTS.right, POINTS.score)))
    found = points_of(Says(odd), IMAGE, IMAGE)
    for mine, other in zip(vars(found).values(), vars(POINTS).values(), strict=True):
        assert mine.tobytes() == other.tobytes()


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (None, "returned a NoneType instead of zpm2.model.PointMatches"),
        (replace(POINTS, left=POINTS.left * np.nan), "returned left points that are not finite"),
        (replace(POINTS, score=POINTS.score * np.inf), "returned scores that are not finite"),
        (
            replace(POINTS, right=POINTS.right[:1]),
            r"right points of shape \(1, 2\) and type float64 instead of \(2, 2\)",
        ),
        (replace(POINTS, score=None), r"scores of shape \(\) and type object"),
        (RuntimeError("no\nmemory"), "raised RuntimeError: no memory$"),
    ],
)
def test_points_that_cannot_be_used(answer: Any, told: str) -> None:
    for match in (
        lambda: points_of(Says(answer), IMAGE, IMAGE),
        lambda: CombinedMatcher([Says(answer)], 0.0, 1.0).match_many([(IMAGE, IMAGE)]),
    ):
        with pytest.raises(PointMatcherError, match=f"^point matcher 'says' .*{told}"):
            match()


def test_many_pairs_have_an_answer_each() -> None:
    with pytest.raises(PointMatcherError, match="returned 2 results for 3 pairs instead of one for each"):
        points_of_many(Says(POINTS), [(IMAGE, IMAGE)] * 3)
