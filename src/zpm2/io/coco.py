"""Polygons of one photograph as COCO annotations with compressed run lengths, made without a mask of its size."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zpm2.model import Mask, Polygon

REGION = "region"  # category of a polygon without a label
DIGITS = 7  # of five bits each, the sign among them: run lengths below 2 ** 34


def coco(
    polygons: Sequence[Polygon],
    masks: Iterable[Mask],
    match_of: Mapping[int, tuple[int, float]] | None,
    image_name: str,
    width: int,
    height: int,
) -> dict[str, Any]:
    """The polygons of an image of `width` x `height` px as a COCO object, ready for JSON and for pycocotools.

    `masks` gives each polygon's pixels, in the order of `polygons`, and is read one at a time; what of a mask lies
    beyond the image is cut off. An annotation's id is the polygon's; "bbox" is [x, y, w, h] px of the pixels and "area"
    their number (all 0 where a polygon has no pixel). "match" and "confidence" are the partner's id and 0..1 of
    `match_of`, null without one. Categories are the labels in their alphabetical order and "region" for polygons
    without; their ids start at 1. `ValueError` where there are not as many masks as polygons.
    """
    partners = match_of or {}
    names = sorted({polygon.label or REGION for polygon in polygons})
    category = {name: k for k, name in enumerate(names, start=1)}
    annotations = []
    for polygon, mask in zip(polygons, masks, strict=True):
        partner, confidence = partners.get(polygon.id, (None, None))
        annotations.append(
            {
                "id": polygon.id,
                "image_id": 1,
                "category_id": category[polygon.label or REGION],
                **_region(mask, width, height),
                "iscrowd": 0,
                "score": polygon.score,
                "match": partner,
                "confidence": confidence,
            }
        )
    return {
        "images": [{"id": 1, "file_name": image_name, "width": width, "height": height}],
        "categories": [{"id": k, "name": name} for name, k in category.items()],
        "annotations": annotations,
    }


def run_lengths(mask: Mask, width: int, height: int) -> NDArray[np.int64]:
    """(k,) lengths of the runs of background, mask, background, ... down the columns of a `width` x `height` px image.

    The first is 0 where the image's first pixel belongs to the mask. The mask must not reach beyond the image.
    """
    return _runs(mask.bits, mask.x0, mask.y0, width, height)


def compressed(counts: NDArray[np.int64]) -> str:
    """(k,) run lengths as COCO's text (maskApi.c, rleToString): five bits a character, lowest first, with a bit for
    "goes on"; from the fourth number on it is the difference to the last but one."""
    values = counts.copy()
    values[3:] -= counts[1:-2]
    place = 5 * np.arange(DIGITS)
    digits = values[:, None] >> place & 31
    rest = values[:, None] >> place + 5
    more = rest != np.where(digits & 16, -1, 0)  # the last digit's highest bit is the sign
    used = np.arange(DIGITS) <= np.argmin(more, axis=1)[:, None]
    return (digits + 32 * more + 48)[used].astype(np.uint8).tobytes().decode("ascii")


def _region(mask: Mask, width: int, height: int) -> dict[str, Any]:
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    bits = mask.bits[top : max(0, height - mask.y0), left : max(0, width - mask.x0)]
    x0, y0 = mask.x0 + left, mask.y0 + top
    columns, rows = np.flatnonzero(bits.any(0)), np.flatnonzero(bits.any(1))
    counts = _runs(bits, x0, y0, width, height)
    box = [0, 0, 0, 0]
    if len(rows):
        box = [int(v) for v in (x0 + columns[0], y0 + rows[0], np.ptp(columns) + 1, np.ptp(rows) + 1)]
    return {
        "bbox": box,
        "area": int(counts[1::2].sum()),
        "segmentation": {"size": [height, width], "counts": compressed(counts)},
    }


def _runs(bits: NDArray[np.bool_], x0: int, y0: int, width: int, height: int) -> NDArray[np.int64]:
    h, w = bits.shape
    columns = np.zeros((w, h + 2), bool)  # with background above and below, so that each run ends in its column
    columns[:, 1:-1] = bits.T
    column, row = np.divmod(np.flatnonzero(columns[:, 1:] != columns[:, :-1]), h + 1)
    edges = np.zeros(len(row) + 2, np.int64)  # 0, then starts and ends by turns, then the end of the image
    edges[1:-1] = (column + x0) * height + row + y0
    edges[-1] = width * height
    counts = np.diff(edges)
    joined = np.flatnonzero(counts[2:-1:2] == 0) * 2 + 2  # at the bottom of one column and the top of the next
    if len(joined):
        edges = np.delete(edges, np.concatenate([joined, joined + 1]))
        counts = np.diff(edges)
    return counts[:-1] if len(counts) > 1 and counts[-1] == 0 else counts
