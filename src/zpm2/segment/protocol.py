"""What the pipeline asks of a source of regions."""

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
    """Gives the regions of one photograph as polygons at once: vertices that exist are not rasterised and traced anew.

    `isinstance(segmenter, PolygonSource)` says whether a segmenter is one.
    """

    def polygons(self, image: Image) -> list[Polygon]:
        """The regions as valid polygons with distinct ids and with parents, in image px."""
        ...


class PromptedView(Protocol):
    """One photograph, encoded once, that can be asked about places as often as wanted."""

    mask_scale: float  # px of a decoded mask per image px
    size: tuple[int, int]  # (height, width) of a decoded mask, px; the longer side has LOW
    image: Image
    batch: int  # prompts that are best asked together on this device

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`."""
        ...

    def cover(self, shapes: NDArray[np.object_]) -> NDArray[np.bool_]:
        """(n,) shapely polygons in image px -> (n, height, width) pixels of a decoded mask that they cover."""
        ...

    def masks(self, predictions: MaskPredictions) -> list[Mask]:
        """Each answer at the image's resolution."""
        ...


@runtime_checkable
class PromptedSegmenter(Protocol):
    """A segmenter that can be asked again about a photograph. `isinstance(segmenter, PromptedSegmenter)` tells."""

    def view(self, image: Image) -> PromptedView:
        """The photograph, encoded."""
        ...
