"""What the pipeline asks of a source of regions."""

from typing import Protocol, runtime_checkable

from zpm2.model import Image, Mask, Polygon


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
