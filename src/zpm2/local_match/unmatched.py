"""Why a polygon has no partner: what users ask first when they compare two epochs or two views."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import LocalConfig
from zpm2.model import ImagePolygons, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons.overlap import beside, iou
from zpm2.polygons.warp import WarpedPolygons

Reason = Literal["outside overlap", "occluded", "no candidate", "rejected"]
REASONS: tuple[Reason, ...] = ("outside overlap", "occluded", "no candidate", "rejected")


def with_reasons(
    sides: tuple[ImagePolygons, ImagePolygons],
    matches: Sequence[PolygonMatch],
    warped: tuple[WarpedPolygons, WarpedPolygons],
    config: LocalConfig,
) -> tuple[ImagePolygons, ImagePolygons]:
    """Both sides with the reason why each unmatched polygon has no partner, as `unmatched`.

    `warped` are the left polygons in the right image, and the right ones in the left. A side's `image` may be reduced.
    """
    polygons = [PolygonArrays(side.polygons) for side in sides]
    rows = [{int(id): k for k, id in enumerate(arrays.ids)} for arrays in polygons]
    partners = np.full(len(polygons[0]), -1, np.int64), np.full(len(polygons[1]), -1, np.int64)
    for match in matches:
        i, j = rows[0][match.left], rows[1][match.right]
        partners[0][i], partners[1][j] = j, i
    found = []
    for k, side in enumerate(sides):
        other = sides[1 - k]
        valid = None if other.image is None else other.image.valid
        visible = visible_share(warped[k], (other.width, other.height), valid)
        reasons = unmatched_reasons(polygons[k], polygons[1 - k], partners[k], warped[k], visible, config)
        found.append(replace(side, unmatched=reasons))
    return found[0], found[1]


def unmatched_reasons(
    polygons: PolygonArrays,
    others: PolygonArrays,
    partner: NDArray[np.int64],
    warped: WarpedPolygons,
    visible: NDArray[np.float64],
    config: LocalConfig,
) -> dict[int, Reason]:
    """Polygon id -> why it has no partner, for those of n polygons without one.

    It is the first of these that holds:

    - "outside overlap": the other photograph does not show most of the warped polygon, or has no data there;
    - "occluded": most of the warped polygon is covered by polygons whose partners lie elsewhere in the first
      photograph;
    - "rejected": a polygon of the other photograph overlaps the warped one (IoU) by `config.min_overlap`, but they look
      different, or another match was better;
    - "no candidate": no polygon overlaps it, or it could not be warped.

    `partner` (n,) is the row of each polygon's partner among `others`, or -1. `warped` are the polygons in the other
    photograph, `visible` (n,) the share of each that it shows. `config.unmatched` says how much is most.
    """
    unmatched = np.flatnonzero(partner < 0)
    shapes = warped.shapes[unmatched]
    known = ~shapely.is_empty(shapes)
    i, j = shapely.STRtree(others.shapes).query(shapes, predicate="intersects")
    overlap = iou(shapes[i], others.shapes[j], config.min_overlap)
    candidate = np.zeros(len(unmatched), bool)
    candidate[i[overlap >= config.min_overlap]] = True
    back = np.full(len(others), -1, np.int64)
    matched = np.flatnonzero(partner >= 0)
    back[partner[matched]] = matched
    limits = config.unmatched
    elsewhere = back[j] >= 0
    elsewhere[elsewhere] = beside(polygons, unmatched[i[elsewhere]], back[j[elsewhere]], limits.max_shared)
    hidden = _covered_share(shapes, others, i[elsewhere], j[elsewhere]) > limits.min_hidden
    found: dict[int, Reason] = {}
    for k, row in enumerate(unmatched):
        reason: Reason = "no candidate"
        if known[k] and visible[row] < limits.min_visible:
            reason = "outside overlap"
        elif hidden[k]:
            reason = "occluded"
        elif candidate[k]:
            reason = "rejected"
        found[int(polygons.ids[row])] = reason
    return found


def visible_share(
    warped: WarpedPolygons, size: tuple[int, int], valid: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """(n,) share of each warped polygon that lies in a photograph of `size` (width, height) px, on pixels with data.

    `valid` (h, w) is where the photograph has data, at any resolution. It is sampled at points half way from a vertex
    to a point inside."""
    shapes = warped.shapes
    inside = shapely.intersection(shapes, shapely.box(0, 0, *size))
    share = shapely.area(inside) / np.maximum(shapely.area(shapes), 1e-300)
    if valid is None:
        return np.asarray(share)
    xy, of = shapely.get_coordinates(inside, return_index=True)
    centers = np.zeros((len(shapes), 2))
    centers[~shapely.is_empty(inside)] = shapely.get_coordinates(shapely.point_on_surface(inside))
    at = (xy + centers[of]) / 2
    column, row = np.clip(at / size * valid.shape[::-1], 0, np.array(valid.shape[::-1]) - 1).astype(np.intp).T
    count = np.bincount(of, minlength=len(shapes))
    return np.asarray(share * np.bincount(of, valid[row, column], len(shapes)) / np.maximum(count, 1))


def _covered_share(
    shapes: NDArray[np.object_], others: PolygonArrays, i: NDArray[np.int64], j: NDArray[np.int64]
) -> NDArray[np.float64]:
    """(l,) share of each shape that the polygons `j` of `others` cover together; `i` are the rows of their shapes."""
    order = np.argsort(i, kind="stable")
    i, j = i[order], j[order]
    share = np.zeros(len(shapes))
    for k, rows in zip(np.unique(i), _equal_runs(i), strict=True):
        cover = shapely.union_all(shapely.intersection(others.shapes[j[rows]], shapes[k]))
        share[k] = cover.area / max(shapes[k].area, 1e-300)
    return share


def _equal_runs(sorted_rows: NDArray[np.int64]) -> Sequence[NDArray[np.intp]]:
    """The indices of each run of equal values."""
    if len(sorted_rows) == 0:
        return []
    return np.split(np.arange(len(sorted_rows)), np.flatnonzero(np.diff(sorted_rows)) + 1)


def without_smaller(
    left: ImagePolygons, right: ImagePolygons, matches: Sequence[PolygonMatch], min_areas: tuple[float, float]
) -> tuple[ImagePolygons, ImagePolygons, list[PolygonMatch]]:
    """Both images and the matches without polygons under `min_areas` px^2 (left, right) and their matches.

    Their partners stay, with "no candidate" as the reason why they have none.
    """
    kept = [
        [polygon for polygon in side.polygons if polygon.area >= min_area]
        for side, min_area in zip((left, right), min_areas, strict=True)
    ]
    ids = [{polygon.id for polygon in polygons} for polygons in kept]
    return (
        _only(left, kept[0], [m.left for m in matches if m.right not in ids[1]]),
        _only(right, kept[1], [m.right for m in matches if m.left not in ids[0]]),
        [match for match in matches if match.left in ids[0] and match.right in ids[1]],
    )


def _only(side: ImagePolygons, polygons: Sequence[Polygon], widowed: Sequence[int]) -> ImagePolygons:
    """The side with no other polygons than these; a parent that is not among them is none. The partners of the ids
    `widowed` are gone."""
    ids = {polygon.id for polygon in polygons}
    adopted = [p if p.parent is None or p.parent in ids else replace(p, parent=None) for p in polygons]
    why: Mapping[int, str] = {**side.unmatched, **dict.fromkeys(widowed, "no candidate")}
    return replace(side, polygons=adopted, unmatched={id: reason for id, reason in why.items() if id in ids})
