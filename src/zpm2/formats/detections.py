"""Polygons of one photograph as the arrays of `supervision.Detections`, which many tools take."""

from collections.abc import Mapping, Sequence
from typing import TypedDict

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.formats.coco import REGION
from zpm2.model import Counterpart, Polygon, PolygonArrays
from zpm2.polygons.rasterize import rasterize_stack

NO_MATCH = -1  # tracker_id of a polygon without a partner


class Detections(TypedDict):
    """The arguments of `supervision.Detections`, for n polygons in their order."""

    xyxy: NDArray[np.float32]  # (n, 4) px, the bounds of the outlines
    mask: NDArray[np.bool_] | None  # (n, height, width)
    confidence: NDArray[np.float32]  # (n,) the segmenter's score
    class_id: NDArray[np.int64]  # (n,) rows of the labels in alphabetical order
    tracker_id: NDArray[np.int64]  # (n,) number of the match, the same in both photographs; -1 without
    data: dict[str, NDArray[np.generic]]  # (n,) class_name, polygon_id, and of the match: match_confidence, else NaN


def detections(
    polygons: Sequence[Polygon], match_of: Mapping[int, Counterpart], size: tuple[int, int], masks: bool = True
) -> Detections:
    """The arrays of a photograph of `size` (width, height) px. Without `masks`, `mask` is None: a byte for each pixel
    and polygon. `InputError` where masks do not fit into the memory budget."""
    arrays, partners = PolygonArrays(polygons), [match_of.get(polygon.id) for polygon in polygons]
    labels = [polygon.label or REGION for polygon in polygons]
    names = sorted(set(labels))
    if masks:
        memory.refuse_above(len(polygons) * size[0] * size[1], "a mask of each polygon", "ask for them without masks")
    return {
        "xyxy": shapely.bounds(arrays.shapes).reshape(-1, 4).astype(np.float32),
        "mask": rasterize_stack(arrays.shapes, size) if masks else None,
        "confidence": np.array([polygon.score for polygon in polygons], np.float32),
        "class_id": np.array([names.index(label) for label in labels], np.int64),
        "tracker_id": np.array([NO_MATCH if each is None else each.match_id for each in partners], np.int64),
        "data": {
            "class_name": np.array(labels, np.str_),
            "polygon_id": arrays.ids,
            "match_confidence": np.array([np.nan if each is None else each.confidence for each in partners]),
        },
    }
