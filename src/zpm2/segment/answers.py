"""What segmenters return, checked, in the one form that zpm2 works with. They may be anybody's."""

import math
from dataclasses import replace
from operator import index, is_
from typing import SupportsIndex, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import SegmenterError
from zpm2.model import Image, Mask, Polygon, shapes_of
from zpm2.plugins import WrongAnswer, answering, listed
from zpm2.polygons.vectorize import cut
from zpm2.segment.predictions import MaskPredictions
from zpm2.segment.protocol import PolygonSource, Segmenter

Part = TypeVar("Part", Mask, Polygon, MaskPredictions)

KIND = "segmenter"


def masks_of(segmenter: Segmenter, image: Image) -> list[Mask]:
    """The regions of an image as pixels inside of it that hold data. `SegmenterError` where the segmenter fails, or its
    masks cannot be used."""
    size = image.width, image.height
    with answering(segmenter, KIND, SegmenterError):
        masks = [mask_of(k, mask) for k, mask in enumerate(listed(segmenter.segment(image), "zpm2.model.Mask"))]
        return masks if image.valid is None else [cut(mask, size).within(image.valid) for mask in masks]


def polygons_of(source: PolygonSource, image: Image) -> list[Polygon]:
    """The regions of an image as valid polygons. `SegmenterError` where the source fails, or its polygons cannot be
    used."""
    with answering(source, KIND, SegmenterError):
        polygons = [_polygon(k, p) for k, p in enumerate(listed(source.polygons(image), "zpm2.model.Polygon"))]
        if len({polygon.id for polygon in polygons}) < len(polygons):
            raise WrongAnswer("two polygons with one id: number them")
        valid = shapely.is_valid(shapes_of(polygons))
        if not valid.all():
            raise WrongAnswer(f"polygon {int(np.argmin(valid))}, which is not valid: repair it (shapely.make_valid)")
        return polygons


def mask_of(k: int, mask: object) -> Mask:
    """Mask `k` of an answer in the form that zpm2 works with, or `WrongAnswer`."""
    if not isinstance(mask, Mask):
        raise WrongAnswer(f"region {k} as a {type(mask).__name__} instead of zpm2.model.Mask(x0, y0, bits, score)")
    what, bits = f"mask {k}", np.asarray(mask.bits)
    if bits.ndim != 2 or bits.dtype.kind not in "biu":
        raise WrongAnswer(f"{what} with bits of shape {bits.shape} and type {bits.dtype} instead of (h, w) and bool")
    x0, y0 = whole(f"{what} with x0", mask.x0), whole(f"{what} with y0", mask.y0)
    score, label = _score(what, mask.score), _label(what, mask.label)
    return unchanged(mask, Mask(x0, y0, bits.astype(bool, copy=False), score, label))


def _polygon(k: int, polygon: object) -> Polygon:
    if not isinstance(polygon, Polygon):
        raise WrongAnswer(f"region {k} as a {type(polygon).__name__} instead of zpm2.model.Polygon(id, exterior, ...)")
    what, parent = f"polygon {k}", polygon.parent
    holes = tuple(_ring(what, hole) for hole in polygon.holes)
    good = replace(
        polygon,
        id=whole(f"{what} with id", polygon.id),
        exterior=_ring(what, polygon.exterior),
        holes=polygon.holes if all(map(is_, holes, polygon.holes)) else holes,
        score=_score(what, polygon.score),
        parent=None if parent is None else whole(f"{what} with parent", parent),
        label=_label(what, polygon.label),
    )
    return unchanged(polygon, good)


def unchanged(part: Part, good: Part) -> Part:
    """The part itself where nothing in it had to change: it may know its shape already."""
    return part if all(getattr(part, name) is value for name, value in vars(good).items()) else good


def _ring(what: str, ring: NDArray[np.float64]) -> NDArray[np.float64]:
    array = np.asarray(ring)
    if array.dtype.kind not in "iuf" or array.shape[1:] != (2,) or len(array) < 3:
        raise WrongAnswer(
            f"{what} with a ring of shape {array.shape} and type {array.dtype} instead of (n, 2), n >= 3, and float64"
        )
    if not np.isfinite(array).all():
        raise WrongAnswer(f"{what} with vertices that are not finite")
    return np.asarray(array, np.float64)


def whole(what: str, value: SupportsIndex) -> int:
    """As an int, also a float without a fraction, or `WrongAnswer`."""
    try:
        return int(value) if isinstance(value, float) and value.is_integer() else index(value)
    except TypeError:
        raise WrongAnswer(f"{what} = {value!r} instead of an int") from None


def _score(what: str, value: object) -> float:
    if type(value) is float and math.isfinite(value):
        return value
    number = np.asarray(value)
    if number.ndim or number.dtype.kind not in "biuf" or not math.isfinite(number):
        raise WrongAnswer(f"{what} with the score {value!r} instead of a float from 0 to 1")
    return float(number)


def _label(what: str, label: object) -> str | None:
    if not (label is None or isinstance(label, str)):
        raise WrongAnswer(f"{what} with the label {label!r} instead of a str or None")
    return label if label is None else str(label)
