"""The views of promptable segmenters of others, which check each answer. They may be anybody's."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import SegmenterError
from zpm2.model import Image, Mask
from zpm2.plugins import WrongAnswer, answering, listed, module_of
from zpm2.segment.answers import KIND, mask_of, unchanged, whole
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import EmbeddedView, PromptedSegmenter, PromptedView, SmallThingsView, WritableSegmenter

Number = TypeVar("Number", bound=np.generic)

MEMBERS = ("mask_scale", "size", "image", "batch", "predict", "cover", "masks")  # of a `PromptedView`


def views_of(
    segmenter: PromptedSegmenter, images: Sequence[Image], encode: Callable[[], Sequence[PromptedView]]
) -> list[PromptedView]:
    """What `encode` makes of the images by a segmenter. The views of one that is not zpm2's own are `CheckedView`s.
    `SegmenterError` where it fails, or they are no views."""
    if module_of(type(segmenter)).startswith("zpm2."):
        return list(encode())
    with answering(segmenter, KIND, SegmenterError):
        views = listed(encode(), "views")
        if len(views) != len(images):
            raise WrongAnswer(f"{len(views)} views of {len(images)} images")
        return [_checked(segmenter, view) for view in views]


def written_of(segmenter: WritableSegmenter, view: PromptedView) -> Mapping[str, NDArray[np.generic]] | None:
    """What the network made of the photograph of one of `views_of`; None where that is not in arrays."""
    with answering(segmenter, KIND, SegmenterError):
        arrays = segmenter.written(view.view if isinstance(view, CheckedView) else view)
        if not (arrays is None or isinstance(arrays, Mapping)):
            raise WrongAnswer(f"a {type(arrays).__name__} instead of a dict of arrays or None")
        return arrays


class CheckedView:
    """A `PromptedView` whose answers have the form that they should have. `SegmenterError` where one cannot be used."""

    def __init__(self, segmenter: PromptedSegmenter, view: PromptedView) -> None:
        self.segmenter, self.view = segmenter, view
        self.image, self.mask_scale = view.image, _scale("mask_scale", view.mask_scale)
        size, self.batch = np.asarray(view.size), whole("a view with batch", view.batch)
        if not isinstance(self.image, Image):
            raise WrongAnswer(f"a view with a {type(self.image).__name__} instead of a zpm2.model.Image")
        if size.shape != (2,) or size.dtype.kind not in "iu" or size.min() < 1:
            raise WrongAnswer(f"a view with size = {view.size!r} instead of (height, width) in px")
        if self.batch < 1:
            raise WrongAnswer(f"a view with batch = {self.batch} instead of at least 1")
        self.size = int(size[0]), int(size[1])

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`."""
        with answering(self.segmenter, KIND, SegmenterError):
            return _predictions(self.view.predict(prompts, thresholds), len(prompts), self.size)

    def cover(self, shapes: NDArray[np.object_]) -> NDArray[np.bool_]:
        """(n,) shapely polygons in image px -> (n, height, width) pixels of a decoded mask inside each."""
        with answering(self.segmenter, KIND, SegmenterError):
            return _array("a cover", self.view.cover(shapes), (len(shapes), *self.size), "biu").astype(bool, copy=False)

    def masks(self, predictions: MaskPredictions) -> list[Mask]:
        """Each mask at the image's resolution."""
        with answering(self.segmenter, KIND, SegmenterError):
            masks = listed(self.view.masks(predictions), "zpm2.model.Mask")
            if len(masks) != len(predictions):
                raise WrongAnswer(f"{len(masks)} masks of {len(predictions)} predictions")
            return [mask_of(k, mask) for k, mask in enumerate(masks)]


class _SmallThings(CheckedView):
    """A checked `SmallThingsView`."""

    def predict_small(
        self,
        prompts: Prompts,
        thresholds: MaskThresholds,
        known: Sequence[MaskPredictions],
        soon: Prompts | None = None,
    ) -> MaskPredictions:
        with answering(self.segmenter, KIND, SegmenterError):
            assert isinstance(self.view, SmallThingsView)
            return _predictions(self.view.predict_small(prompts, thresholds, known, soon), len(prompts), self.size)


class _Embedded(CheckedView):
    """A checked `EmbeddedView`."""

    def __init__(self, segmenter: PromptedSegmenter, view: PromptedView) -> None:
        super().__init__(segmenter, view)
        assert isinstance(view, EmbeddedView)
        self.embedding_scale = _scale("embedding_scale", view.embedding_scale)

    def embedding(self) -> NDArray[np.float32]:
        with answering(self.segmenter, KIND, SegmenterError):
            assert isinstance(self.view, EmbeddedView)
            return _array("an embedding", self.view.embedding(), (None, None, None), "f")


def _checked(segmenter: PromptedSegmenter, view: PromptedView) -> CheckedView:
    """A `CheckedView` that implements what `view` does."""
    missing = [name for name in MEMBERS if not hasattr(view, name)]
    if missing:
        raise WrongAnswer(f"a {type(view).__name__} as a view, which has no {', '.join(missing)}")
    small, embedded = isinstance(view, SmallThingsView), isinstance(view, EmbeddedView)
    kinds = [kind for kind, wanted in ((_SmallThings, small), (_Embedded, embedded)) if wanted]
    made: type[CheckedView] = type("CheckedView", (*kinds, CheckedView), {})
    return made(segmenter, view)


def _predictions(found: object, prompts: int, size: tuple[int, int]) -> MaskPredictions:
    """The answer to so many prompts, in a view of `size`."""
    if not isinstance(found, MaskPredictions):
        raise WrongAnswer(f"a {type(found).__name__} instead of zpm2.segment.predictions.MaskPredictions")
    n, logits, measured = np.size(found.prompt), found.logits, found.measured
    prompt = _array("prompt", found.prompt, (n,), "iu")
    if n and not 0 <= prompt.min() <= prompt.max() < prompts:
        raise WrongAnswer(f"prompt with rows from {prompt.min()} to {prompt.max()} of {prompts} prompts")
    shape = getattr(logits, "shape", None)  # of an array or of a tensor, which stays on its device
    if shape != (n, *size) or (isinstance(logits, np.ndarray) and logits.dtype.kind not in "biuf"):
        raise WrongAnswer(f"logits of shape {shape} instead of {(n, *size)} numbers, as size of the view says")
    if measured is not None and (np.shape(measured.area) != (n,) or np.shape(measured.box) != (n, 4)):
        raise WrongAnswer(f"measured that is no zpm2.segment.stacks.Extent of {n} masks: leave it out")
    score = _array("score", found.score, (n,), "biuf")
    stability = _array("stability", found.stability, (n,), "biuf")
    return unchanged(found, replace(found, prompt=prompt, score=score, stability=stability))


def _array(what: str, value: NDArray[Number], shape: tuple[int | None, ...], kinds: str) -> NDArray[Number]:
    """As an array of numbers of that shape, None for any length, with a type of one of the `kinds`."""
    array = np.asarray(value)
    fits = array.ndim == len(shape) and all(n in (None, given) for n, given in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in kinds:
        wanted = ", ".join("n" if n is None else str(n) for n in shape)
        raise WrongAnswer(f"{what} of shape {array.shape} and type {array.dtype} instead of ({wanted}) and numbers")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise WrongAnswer(f"{what} with numbers that are not finite")
    return array


def _scale(name: str, value: float) -> float:
    if not (isinstance(value, int | float | np.number) and 0 < value < inf):
        raise WrongAnswer(f"a view with {name} = {value!r} instead of a number above 0")
    return value
