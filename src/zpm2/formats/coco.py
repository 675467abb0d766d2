"""Polygons of one photograph as COCO annotations with compressed run lengths. No mask of the whole image is made."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from zpm2.formats.convert import Members
from zpm2.formats.properties import OURS as POLYGONS
from zpm2.formats.properties import polygon_properties, prefixed
from zpm2.formats.run_lengths import compressed, run_lengths
from zpm2.model import Counterpart, Mask, Polygon

CONTRIBUTOR = "zpm2"  # in the file's "info": tells our own files from others
OURS = POLYGONS | {"id", "polygon_id", "image_id", "category_id", "segmentation", "bbox", "iscrowd"}
REGION = "region"  # category of a polygon without a label


def coco(
    polygons: Sequence[Polygon],
    masks: Iterable[Mask],
    match_of: Mapping[int, Counterpart] | None,
    image_name: str,
    width: int,
    height: int,
    unmatched: Mapping[int, str] | None = None,
) -> dict[str, object]:
    """The polygons of an image of `width` x `height` px as a COCO object, ready for JSON and for pycocotools.

    `masks` gives each polygon's pixels, in the order of `polygons`, and is read one at a time; masks are cut at the
    image's border. Annotations are numbered from 1, as COCOeval takes 0 for none; "polygon_id" is
    the polygon's id. "bbox" is [x, y, w, h] px of the pixels and "area" their number (all 0 where a polygon has no
    pixel). All else is as in our GeoJSON: `match_of` gives a polygon's match, `unmatched` why it has none. Categories
    are the labels in their alphabetical order and "region" for polygons without; their ids start at 1. `ValueError`
    where there are not as many masks as polygons.
    """
    partners, reasons = match_of or {}, unmatched or {}
    names = sorted({_category(polygon) for polygon in polygons})
    category = {name: k for k, name in enumerate(names, start=1)}
    annotations = [
        {
            **polygon_properties(polygon, partners.get(polygon.id), reasons.get(polygon.id)),
            **prefixed(polygon.properties, OURS),
            "id": k,
            "polygon_id": polygon.id,
            "image_id": 1,
            "category_id": category[_category(polygon)],
            **pixels(mask, width, height),
            "iscrowd": 0,
        }
        for k, (polygon, mask) in enumerate(zip(polygons, masks, strict=True), start=1)
    ]
    return {
        "info": {"contributor": CONTRIBUTOR},
        "images": [{"id": 1, "file_name": image_name, "width": width, "height": height}],
        "categories": [{"id": k, "name": name} for name, k in category.items()],
        "annotations": annotations,
    }


def _category(polygon: Polygon) -> str:
    return REGION if polygon.label is None else polygon.label


def pixels(mask: Mask, width: int, height: int) -> Members:
    """The members "bbox", "area" and "segmentation" of an annotation for a mask, cut at the image's border."""
    left, top = max(0, -mask.x0), max(0, -mask.y0)
    bits = mask.bits[top : max(0, height - mask.y0), left : max(0, width - mask.x0)]
    x0, y0 = mask.x0 + left, mask.y0 + top
    columns, rows = np.flatnonzero(bits.any(0)), np.flatnonzero(bits.any(1))
    counts = run_lengths(Mask(x0, y0, bits), width, height)
    box = [0, 0, 0, 0]
    if len(rows):
        box = [int(v) for v in (x0 + columns[0], y0 + rows[0], np.ptp(columns) + 1, np.ptp(rows) + 1)]
    return {
        "bbox": box,
        "area": int(counts[1::2].sum()),
        "segmentation": {"size": [height, width], "counts": compressed(counts)},
    }
