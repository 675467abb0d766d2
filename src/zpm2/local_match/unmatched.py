"""Why a polygon has no partner: what users ask first when two epochs or two views are compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import ImagePolygons, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons.overlap import overlaps
from zpm2.polygons.warp import WarpedPolygons

Reason = Literal["outside overlap", "occluded", "no candidate", "rejected"]
REASONS: tuple[Reason, ...] = ("outside overlap", "occluded", "no candidate", "rejected")
MOSTLY = 0.5  # share of a polygon's place that must be seen, and that others must cover to hide it
APART = 0.1  # share of a polygon that what hides it may overlap in its own photograph: neighbours touch


def reasons(
    polygons: PolygonArrays,
    others: PolygonArrays,
    partner: NDArray[np.int64],
    warped: WarpedPolygons,
    seen: NDArray[np.float64],
    min_overlap: float,
) -> dict[int, Reason]:
    """Polygon id -> why it has no partner, for those of n polygons without one.

    It is the first of these that holds:

    - "outside overlap": less than half of the place where it should be is in the other photograph, or has data there;
    - "occluded": most of that place is covered by polygons whose partners are elsewhere in its own photograph;
    - "rejected": a polygon of the other photograph overlaps that place (IoU) by `min_overlap` and was not taken: they
      look different, or another match was better;
    - "no candidate": there is none, or it is not known where it should be.

    `partner` (n,) is the row of each polygon's partner among `others`, or -1; `warped` the polygons in the other
    photograph, and `seen` (n,) the share of each that is visible there.
    """
    unmatched = np.flatnonzero(partner < 0)
    shapes = warped.shapes[unmatched]
    known = ~shapely.is_empty(shapes)
    i, j = shapely.STRtree(others.shapes).query(shapes, predicate="intersects")
    overlap = overlaps(shapes[i], others.shapes[j])
    candidate = np.zeros(len(unmatched), bool)
    candidate[i[overlap >= min_overlap]] = True
    back = np.full(len(others), -1, np.int64)
    matched = np.flatnonzero(partner >= 0)
    back[partner[matched]] = matched
    hidden = _covered(polygons, unmatched, shapes, i, j, back, others) > MOSTLY
    found: dict[int, Reason] = {}
    for k, row in enumerate(unmatched):
        reason: Reason = "no candidate"
        if known[k] and seen[row] < MOSTLY:
            reason = "outside overlap"
        elif hidden[k]:
            reason = "occluded"
        elif candidate[k]:
            reason = "rejected"
        found[int(polygons.ids[row])] = reason
    return found


def visible(
    warped: WarpedPolygons, size: tuple[int, int], valid: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """(n,) share of each carried polygon that lies in a photograph of `size` (width, height) px, on pixels with data.

    `valid` (h, w) says of all of the photograph, at whatever resolution, where there are data."""
    shapes = warped.shapes
    inside = shapely.intersection(shapes, shapely.box(0, 0, *size))
    share = shapely.area(inside) / np.maximum(shapely.area(shapes), 1e-300)
    if valid is None:
        return np.asarray(share)
    xy, of = shapely.get_coordinates(inside, return_index=True)
    middle = shapely.get_coordinates(shapely.point_on_surface(inside))
    full = np.flatnonzero(~shapely.is_empty(inside))
    centers = np.zeros((len(shapes), 2))
    centers[full] = middle
    at = (xy + centers[of]) / 2  # half way from the outline to a point inside
    column, row = np.clip(at / size * valid.shape[::-1], 0, np.array(valid.shape[::-1]) - 1).astype(np.intp).T
    count = np.bincount(of, minlength=len(shapes))
    return np.asarray(share * np.bincount(of, valid[row, column], len(shapes)) / np.maximum(count, 1))


def _covered(
    polygons: PolygonArrays,
    unmatched: NDArray[np.intp],
    shapes: NDArray[np.object_],
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    back: NDArray[np.int64],
    others: PolygonArrays,
) -> NDArray[np.float64]:
    """(l,) share of each carried shape under other polygons whose partners lie apart from the polygon."""
    keep = back[j] >= 0
    i, j = i[keep], j[keep]
    own, theirs = polygons.shapes[unmatched[i]], polygons.shapes[back[j]]
    common = shapely.area(shapely.intersection(own, theirs))
    apart = common <= APART * np.minimum(shapely.area(own), shapely.area(theirs))
    i, j = i[apart], j[apart]
    order = np.argsort(i, kind="stable")
    i, j = i[order], j[order]
    share = np.zeros(len(unmatched))
    for k, rows in zip(np.unique(i), _parts(i), strict=True):
        cover = shapely.union_all(shapely.intersection(others.shapes[j[rows]], shapes[k]))
        share[k] = cover.area / max(shapes[k].area, 1e-300)
    return share


def _parts(sorted_rows: NDArray[np.int64]) -> Sequence[NDArray[np.intp]]:
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
