"""Names, several methods as one, and non-maximum suppression against a plain loop."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import PointsConfig
from zpm2.errors import ConfigError
from zpm2.features import METHODS, create
from zpm2.features.combined import CombinedMatcher, distinct
from zpm2.model import Image, PointMatches

IMAGE = Image(np.zeros((20, 20, 3), np.uint8))


@dataclass(frozen=True)
class Fixed:
    name: str
    matches: PointMatches

    def match(self, left: Image, right: Image) -> PointMatches:
        return self.matches


def matches(*rows: tuple[float, float, float, float, float]) -> PointMatches:
    table = np.array(rows, np.float64).reshape(-1, 5)
    return PointMatches(table[:, :2], table[:, 2:4], table[:, 4])


def one_by_one(found: PointMatches, radius: float) -> list[bool]:
    """The definition: best first, kept unless close in both images to one that was kept."""
    kept: list[int] = []
    for k in np.argsort(-found.score, kind="stable"):
        apart = [np.hypot(*(p[kept] - p[k]).T) > radius for p in (found.left, found.right)]
        if not kept or (apart[0] | apart[1]).all():
            kept.append(int(k))
    return [k in kept for k in range(len(found))]


@given(st.lists(st.tuples(*[st.integers(0, 6)] * 5), max_size=40), st.sampled_from([1.0, 1.5, 3.0]))
def test_distinct_is_greedy_suppression(rows: list[tuple[int, ...]], radius: float) -> None:
    found = matches(*[(a / 2, b / 2, c / 2, d / 2, s / 6) for a, b, c, d, s in rows])
    assert distinct(found, radius).tolist() == one_by_one(found, radius)


def test_combined_keeps_the_better_of_two_and_what_only_one_image_shares() -> None:
    first = Fixed("first", matches((5, 5, 9, 9, 0.5), (1, 1, 2, 2, 0.4), (7, 7, 7, 7, 0.05)))
    second = Fixed("second", matches((5.5, 5, 9, 9.5, 0.9), (1, 1, 2, 8, 0.3)))
    both = CombinedMatcher([first, second], min_score=0.1, merge_px=1.0)
    found = both.match(IMAGE, IMAGE)
    assert both.name == "first+second"
    assert found.score.tolist() == [0.4, 0.9, 0.3]
    assert found.left.tolist() == [[1, 1], [5.5, 5], [1, 1]]


def test_nothing_and_nothing() -> None:
    empty = Fixed("empty", PointMatches.empty())
    assert len(CombinedMatcher([empty, empty], 0.0, 1.0).match(IMAGE, IMAGE)) == 0


def test_create_needs_no_weights_for_sift() -> None:
    assert create(PointsConfig(methods=("sift", "sift"))).name == "sift+sift"


def test_unknown_method() -> None:
    message = "unknown point method 'sfit' (did you mean 'sift'?); methods are: " + ", ".join(METHODS)
    with pytest.raises(ConfigError, match=f"^{re.escape(message)}$"):
        create(PointsConfig(methods=("xfeat", "sfit")), "cpu", 0)


@pytest.mark.weights
def test_two_real_methods_together() -> None:
    texture = np.random.default_rng(0).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    image = Image(np.kron(texture, np.ones((10, 10, 1), np.uint8)))
    alone = [create(PointsConfig(methods=(m,))).match(image, image) for m in ("sift", "xfeat")]
    together = create(PointsConfig(methods=("sift", "xfeat"))).match(image, image)
    assert min(len(a) for a in alone) > 0
    assert max(len(a) for a in alone) < len(together) <= sum(len(a) for a in alone)
