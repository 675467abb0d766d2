"""One image of a pair with its polygons."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from zpm2.model.brief import brief
from zpm2.model.georeference import Georeference
from zpm2.model.image import Image
from zpm2.model.polygon import Polygon

SideName = Literal["left", "right"]
SIDES: tuple[SideName, SideName] = ("left", "right")  # the images of a pair


@dataclass(frozen=True, eq=False)
class ImagePolygons:
    """One image of the pair and everything that was found in it, matched or not."""

    width: int  # px
    height: int  # px
    polygons: Sequence[Polygon]
    path: str | None = None
    image: Image | None = field(default=None, repr=False)  # while in memory; of a large photograph a reduced one
    geo: Georeference = field(default_factory=Georeference)
    unmatched: Mapping[int, str] = field(default_factory=dict)  # id -> why a polygon has no partner

    __repr__ = brief
