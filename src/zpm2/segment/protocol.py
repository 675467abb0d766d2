"""What the pipeline needs from a source of regions.

A segmenter has `name` and `segment`. It may have more, each told by `isinstance`: `polygons` (`PolygonSource`), `view`
(`PromptedSegmenter`; the view may be an `EmbeddedView` and a `SmallThingsView`), `views_together` (`JointSegmenter`),
`written` (`WritableSegmenter`), `notes` (`HasNotes`), `path` (`FromFile`).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from zpm2.model import Image, Mask, Polygon
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts


class Segmenter(Protocol):
    """Finds the regions of one photograph as pixels."""

    name: str

    def segment(self, image: Image) -> list[Mask]:
        """The regions as crops with scores, in an order that does not change from run to run. They may overlap."""
        ...


@runtime_checkable
class PolygonSource(Protocol):
    """A segmenter whose regions are polygons already. Their vertices are used as they are, not rasterised and
    traced."""

    def polygons(self, image: Image) -> list[Polygon]:
        """The regions as valid polygons with distinct ids and with parents, in image px."""
        ...


@runtime_checkable
class HasNotes(Protocol):
    """A segmenter that has something to tell the user about its last image."""

    notes: Sequence[str]


@runtime_checkable
class FromFile(Protocol):
    """A segmenter whose regions come from a file. What depends on them depends on the content of that file."""

    path: Path


def notes_of(segmenter: Segmenter) -> list[str]:
    """What a segmenter has to tell about its last image; nothing for one without `notes`."""
    notes = segmenter.notes if isinstance(segmenter, HasNotes) else []
    return [notes] if isinstance(notes, str) else list(notes or [])


class PromptedView(Protocol):
    """One photograph, encoded once, that takes any number of prompts."""

    mask_scale: float  # px of a decoded mask per image px
    size: tuple[int, int]  # (height, width) of a decoded mask, px; the longer side has MASK_SIDE
    image: Image
    batch: int  # prompts at a time that suit this device

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`."""
        ...

    def cover(self, shapes: NDArray[np.object_]) -> NDArray[np.bool_]:
        """(n,) shapely polygons in image px -> (n, height, width) pixels of a decoded mask inside each."""
        ...

    def masks(self, predictions: MaskPredictions) -> list[Mask]:
        """Each mask at the image's resolution."""
        ...


@runtime_checkable
class SmallThingsView(Protocol):
    """A `PromptedView` that is faster where prompts mostly show something small."""

    def predict_small(
        self,
        prompts: Prompts,
        thresholds: MaskThresholds,
        known: Sequence[MaskPredictions],
        soon: Prompts | None = None,
    ) -> MaskPredictions:
        """As `predict`. A large mask may be one of the `known` ones, if it looks like that where the view sees both.
        `soon` are prompts of the same form that are likely to be next: a view may begin with them, and what it says to
        a prompt does not depend on them."""
        ...


@runtime_checkable
class EmbeddedView(Protocol):
    """A `PromptedView` that shows what its encoder made of the photograph."""

    embedding_scale: float  # cells of the embedding per image px

    def embedding(self) -> NDArray[np.float32]:
        """(c, h, w) one vector for each cell; the photograph alone, without padding. Vectors may be off by one common
        vector: compare their differences."""
        ...


@runtime_checkable
class PromptedSegmenter(Protocol):
    """A segmenter that takes prompts."""

    def view(self, image: Image) -> PromptedView:
        """The photograph, encoded."""
        ...


@runtime_checkable
class JointSegmenter(PromptedSegmenter, Protocol):
    """A `PromptedSegmenter` that encodes several photographs at once, where that is faster."""

    def views_together(self, images: Sequence[Image]) -> Sequence[PromptedView]:
        """The photographs, encoded."""
        ...


@runtime_checkable
class WritableSegmenter(PromptedSegmenter, Protocol):
    """A `PromptedSegmenter` whose views can be put aside on disk."""

    def written(self, view: PromptedView) -> Mapping[str, NDArray[np.generic]] | None:
        """What the network made of the photograph of one of its views; None where that is not in arrays."""
        ...

    def view_of_written(self, image: Image, arrays: Mapping[str, NDArray[np.generic]]) -> PromptedView:
        """The view again, with the same bytes."""
        ...
