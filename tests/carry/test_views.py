"""Photographs are encoded once while they are among the last ones."""

from dataclasses import dataclass, field, replace

import numpy as np
from painted import PaintedView, blank

from zpm2.carry.views import EncodedOnce, LastViews


@dataclass
class Counting:
    """Makes views, and counts them."""

    made: list = field(default_factory=list)

    def view(self, image):
        self.made.append(PaintedView(image, []))
        return self.made[-1]


def test_a_left_photograph_is_encoded_once_for_several_right_ones():
    segmenter = Counting()
    once = EncodedOnce(segmenter, LastViews())
    left, *rights = (blank(seed=seed) for seed in range(4))
    views = [(once.view(replace(left)), once.view(right)) for right in rights]
    assert len(segmenter.made) == 4
    assert all(view is views[0][0] for view, _ in views)
    assert all(np.array_equal(view.image.rgb, right.rgb) for (_, view), right in zip(views, rights, strict=True))


def test_views_are_told_apart_by_pixels_form_and_data():
    segmenter = Counting()
    once = EncodedOnce(segmenter, LastViews())
    image = blank(64, 64)
    other = replace(image, rgb=image.rgb.reshape(32, 128, 3))
    partly = replace(image, valid=np.arange(64 * 64).reshape(64, 64) > 100)
    for each in (image, other, partly):
        once.view(each)
    assert len(segmenter.made) == 3


def test_few_views_are_kept():
    segmenter = Counting()
    once = EncodedOnce(segmenter, LastViews())
    for seed in (0, 1, 2, 0):
        once.view(blank(seed=seed))
    assert len(segmenter.made) == 4
