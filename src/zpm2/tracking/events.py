"""Splits and merges: one region of a photograph whose place in another is filled by several."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import LocalConfig, TracksConfig
from zpm2.errors import Failed
from zpm2.model import PointMatches, Polygon, PolygonArrays, shapes_of
from zpm2.polygons.warp import warp_by_points
from zpm2.tracking.matches import PairMatches

UNKNOWN = Failed("the pair has no homography")


@dataclass(frozen=True)
class Event:
    """In `whole_in` one region, in `parts_in` several others that fill its place."""

    kind: Literal["split", "merge"]  # split: the whole is in the earlier photograph
    whole: int  # id of its track
    parts: tuple[int, ...]  # ids of theirs, ascending
    whole_in: int  # row of the photograph
    parts_in: int


def events(
    seen: Mapping[int, Mapping[int, Polygon]],
    pair: tuple[int, int],
    matches: PairMatches,
    tracks: TracksConfig,
    local: LocalConfig,
) -> list[Event]:
    """Those between the photographs of a pair. `seen` has the polygon of each track, by photograph and by its id.

    The place of a region without counterpart is where the points of the pair put it. Its parts are regions without
    counterpart that lie in it, by `part_inside`, and hardly overlap, the largest first; two of them or more must cover
    it by `parts_cover`.
    """
    points, matrix = matches.points, matches.homography
    back = PointMatches(points.right, points.left, points.score)
    inverse = None if matrix is None else np.asarray(np.linalg.inv(matrix))
    ways = ((pair[0], pair[1], points, matrix), (pair[1], pair[0], back, inverse))
    found = []
    for here, there, forward, homography in ways:
        wholes = [id for id in sorted(seen[here]) if id not in seen[there]]
        others = [id for id in sorted(seen[there]) if id not in seen[here]]
        if not wholes or len(others) < 2 or not len(forward):
            continue
        of_pair = UNKNOWN if homography is None else homography
        places = warp_by_points(PolygonArrays([seen[here][id] for id in wholes]), forward, of_pair, local).shapes
        shapes = shapes_of([seen[there][id] for id in others])
        for whole, place in zip(wholes, places, strict=True):
            parts = parts_of(place, shapes, tracks)
            if len(parts) >= 2:
                kind: Literal["split", "merge"] = "split" if here < there else "merge"
                found.append(Event(kind, whole, tuple(sorted(others[k] for k in parts)), here, there))
    return found


def parts_of(place: shapely.Geometry, shapes: NDArray[np.object_], config: TracksConfig) -> list[int]:
    """Rows of the shapes that together fill a place; none where they do not."""
    if place.is_empty or not place.area:
        return []
    inside = shapely.area(shapely.intersection(place, shapes))
    area = shapely.area(shapes)
    within = np.flatnonzero(inside >= config.part_inside * np.maximum(area, 1e-300))
    taken: list[int] = []
    for k in within[np.argsort(-area[within], kind="stable")].tolist():
        free = all(shapes[k].intersection(shapes[other]).area <= (1 - config.part_inside) * area[k] for other in taken)
        if free and area[k] < config.part_inside * place.area:
            taken.append(k)
    covered = sum(float(inside[k]) for k in taken)
    return taken if covered >= config.parts_cover * place.area else []
