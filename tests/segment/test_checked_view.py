"""Views of segmenters of others: what is right stays as it is, the rest is an error that names the segmenter."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from painted import PaintedView, Region, blank

from zpm2.config import SegmentConfig
from zpm2.errors import SegmenterError
from zpm2.guided.regions import _views
from zpm2.model import Image
from zpm2.photos.kept import NOTHING_KEPT
from zpm2.segment.checked_view import CheckedView, views_of, written_of
from zpm2.segment.classical import ClassicalSegmenter, TreeView
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import EmbeddedView, PromptedView, SmallThingsView
from zpm2.segment.view_of import view_of

IMAGE = blank()
EVERY = MaskThresholds(0.0, 0.0)
SHAPES = np.array([shapely.box(20, 20, 60, 60)], object)
PROMPTS = Prompts.at(np.array([[40.0, 40.0]]))
Change = Callable[[Any], Any]


def painted() -> PaintedView:
    return PaintedView(IMAGE, [Region(SHAPES[0])])


class Rich(PaintedView):
    """A view with all that one may have."""

    embedding_scale = 0.5

    def predict_small(
        self,
        prompts: Prompts,
        thresholds: MaskThresholds,
        known: Sequence[MaskPredictions],
        soon: Prompts | None = None,
    ) -> MaskPredictions:
        return self.predict(prompts, thresholds)

    def embedding(self) -> NDArray[np.float32]:
        return np.ones((2, 4, 4), np.float32)


@dataclass
class Says:
    """A segmenter that makes the `views` that it is told, or raises them."""

    views: list[Any]
    name: str = "says"
    seen: list[PromptedView] = field(default_factory=list)

    def view(self, image: Image) -> PromptedView:
        return self.views_together([image])[0]

    def views_together(self, images: Sequence[Image]) -> Sequence[PromptedView]:
        if isinstance(self.views[0], BaseException):
            raise self.views[0]
        return self.views

    def segment(self, image: Image) -> list[Any]:
        return []

    def written(self, view: PromptedView) -> Mapping[str, NDArray[np.generic]]:
        self.seen.append(view)
        return {}

    def view_of_written(self, image: Image, arrays: Mapping[str, NDArray[np.generic]]) -> PromptedView:
        return self.view(image)


def answers(view: PromptedView) -> list[Any]:
    found = view.predict(PROMPTS, EVERY)
    more = view.predict_small(PROMPTS, EVERY, []) if isinstance(view, SmallThingsView) else None
    cells = view.embedding() if isinstance(view, EmbeddedView) else None
    return [found, view.masks(found), view.cover(SHAPES), more, cells]


def test_views_of_zpm2_stay_the_same_objects() -> None:
    segmenter = ClassicalSegmenter(SegmentConfig())
    view = segmenter.view(IMAGE)
    assert views_of(segmenter, [IMAGE], lambda: [view]) == [view]
    assert type(view_of(segmenter, IMAGE, NOTHING_KEPT)) is TreeView


def test_what_is_right_stays_as_it_is() -> None:
    own = painted()
    view = view_of(Says([own]), IMAGE, NOTHING_KEPT)
    assert (view.image, view.size, view.mask_scale, view.batch) == (own.image, own.size, own.mask_scale, own.batch)
    (found, masks, cover, *_), (found_by_own, masks_by_own, cover_by_own, *_) = answers(view), answers(own)
    assert found.logits.tobytes() == found_by_own.logits.tobytes()
    assert [mask.bits.tobytes() for mask in masks] == [mask.bits.tobytes() for mask in masks_by_own]
    assert np.array_equal(cover, cover_by_own)


@pytest.mark.parametrize(("view", "more"), [(painted(), False), (Rich(IMAGE, [Region(SHAPES[0])]), True)])
def test_a_view_is_what_it_was_besides(view: PaintedView, more: bool) -> None:
    checked = view_of(Says([view]), IMAGE, NOTHING_KEPT)
    assert isinstance(checked, CheckedView)
    assert [isinstance(checked, kind) for kind in (SmallThingsView, EmbeddedView)] == [more, more]
    *_, small, cells = answers(checked)
    assert not more or (len(small), cells.shape) == (1, (2, 4, 4))


def test_a_segmenter_writes_its_own_view() -> None:
    segmenter = Says([painted()])
    assert written_of(segmenter, view_of(segmenter, IMAGE, NOTHING_KEPT)) == {}
    assert segmenter.seen[0] is segmenter.views[0]


def test_views_that_are_encoded_together() -> None:
    segmenter = Says([painted(), painted()])
    assert all(isinstance(view, CheckedView) for view in _views([segmenter, segmenter], (IMAGE, IMAGE)))
    with pytest.raises(SegmenterError, match="returned 1 views of 2 images"):
        _views([one := Says([painted()]), one], (IMAGE, IMAGE))


@pytest.mark.parametrize(
    ("view", "told"),
    [
        (RuntimeError("no\nnetwork"), "raised RuntimeError: no network$"),
        (None, "returned a NoneType as a view, which has no mask_scale, size"),
        ({"size": (256,)}, r"returned a view with size = \(256,\) instead of \(height, width\) in px"),
        ({"mask_scale": None}, "returned a view with mask_scale = None instead of a number above 0"),
        ({"batch": 0}, "returned a view with batch = 0 instead of at least 1"),
        ({"image": None}, "returned a view with a NoneType instead of a zpm2.model.Image"),
    ],
)
def test_what_is_no_view(view: Any, told: str) -> None:
    if isinstance(view, dict):
        own = painted()
        members = ("image", "mask_scale", "size", "batch", "predict", "cover", "masks")
        view = SimpleNamespace(**{name: getattr(own, name) for name in members} | view)
    with pytest.raises(SegmenterError, match=f"^segmenter 'says' {told}"):
        view_of(Says([view]), IMAGE, NOTHING_KEPT)


def nothing(_: object) -> None:
    """No answer."""


def fails(_: object) -> None:
    raise KeyError("m")


@pytest.mark.parametrize("method", ["predict", "predict_small", "masks", "cover", "embedding"])
@pytest.mark.parametrize(("change", "told"), [(nothing, "returned "), (fails, "raised KeyError: 'm'")])
def test_every_answer_is_checked(method: str, change: Change, told: str) -> None:
    check(method, change, told)


@pytest.mark.parametrize(
    ("method", "change", "told"),
    [
        ("predict", lambda found: replace(found, logits=found.logits[:, ::2]), r"logits of shape \(1, 128, 256\)"),
        ("predict", lambda found: replace(found, logits=None), "logits of shape None"),
        ("predict", lambda found: replace(found, prompt=found.prompt + 1), "prompt with rows from 1 to 1 of 1 prompts"),
        ("predict", lambda found: replace(found, prompt=found.prompt - 1), "prompt with rows from -1 to -1"),
        ("predict", lambda found: replace(found, prompt=found.prompt / 1), r"prompt of shape \(1,\) and type float64"),
        ("predict", lambda found: replace(found, score=found.score * np.nan), "score with numbers that are not finite"),
        ("predict", lambda found: replace(found, stability=found.score[:0]), r"stability of shape \(0,\)"),
        ("predict", lambda found: replace(found, measured=found[np.zeros(2, int)].extent), "measured that is no"),
        ("masks", lambda masks: masks[:-1], "0 masks of 1 predictions"),
        ("masks", lambda masks: [replace(masks[0], bits=masks[0].bits / 1)], r"mask 0 with bits of shape .* float64"),
        ("masks", lambda masks: [replace(masks[0], score=np.nan)], "mask 0 with the score nan"),
        ("cover", lambda cover: cover[0], r"a cover of shape \(256, 256\) and type bool instead of \(1, 256, 256\)"),
        ("embedding", lambda cells: cells[0], r"an embedding of shape \(4, 4\) .* instead of \(n, n, n\)"),
        ("embedding", lambda cells: cells * np.nan, "an embedding with numbers that are not finite"),
    ],
)
def test_answers_that_cannot_be_used(method: str, change: Change, told: str) -> None:
    check(method, change, f"returned {told}")


def check(method: str, change: Change, told: str) -> None:
    """Whether an error tells of a view that changes one of its answers."""
    own = Rich(IMAGE, [Region(SHAPES[0])])
    right = getattr(own, method)
    setattr(own, method, lambda *given: change(right(*given)))
    with pytest.raises(SegmenterError, match=f"^segmenter 'says' {told}"):
        answers(view_of(Says([own]), IMAGE, NOTHING_KEPT))
