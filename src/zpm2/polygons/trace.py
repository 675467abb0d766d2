"""Masks to polygons along pixel edges, exact: areas are pixel counts."""

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import Mask, shapes_of_rings


def trace(bits: NDArray[np.bool_], x0: int = 0, y0: int = 0) -> list[shapely.Polygon]:
    """The outlines of a (h, w) mask whose first pixel is column `x0`, row `y0`: one polygon per 4-connected piece, with
    its holes, the largest first, along pixel edges and exact: areas are pixel counts. No vertex lies on a straight run.

    >>> trace(np.ones((3, 4), bool))[0].area
    12.0
    """
    parts = pieces(Mask(x0, y0, bits))
    corners = [np.array([part.x0, part.y0]) for part in parts]
    rings = [[ring + at for ring in rings_of_piece(part.bits)] for part, at in zip(parts, corners, strict=True)]
    return list(shapes_of_rings(rings))


def pieces(mask: Mask, min_area: float = 0.0, most: int | None = None) -> list[Mask]:
    """The 4-connected pieces of a mask with at least `min_area` pixels, each in its own crop, the largest first, and no
    more than `most`."""
    if not mask.bits.any():
        return []
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.bits.view(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    found = []
    for k in np.argsort(-areas, kind="stable")[:most]:
        if areas[k] < min_area:
            break
        x, y, w, h = (int(v) for v in stats[k + 1, :4])
        crop = slice(y, y + h), slice(x, x + w)
        bits = mask.bits[crop] if count == 2 else labels[crop] == k + 1
        found.append(Mask(mask.x0 + x, mask.y0 + y, bits, mask.score, mask.label))
    return found


def rings_of_piece(bits: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """The exact outline of one 4-connected piece that fills its (h, w) crop: its rings (n, 2), the exterior first,
    without closing vertices.

    OpenCV's contours run through pixel centres. On the piece enlarged twice, the centre at k lies beside the pixel edge
    (k + 1) // 2 of the original, for exteriors, holes and concave corners alike.
    """
    enlarged = bits.repeat(2, axis=0).repeat(2, axis=1).view(np.uint8)
    contours, hierarchy = cv2.findContours(enlarged, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    rings = [_corners((contour.reshape(-1, 2) + 1) // 2) for contour in contours]
    inner = hierarchy[0, :, 3] >= 0
    exterior = rings[int(np.argmin(inner))]
    return [exterior, *(ring for ring, is_hole in zip(rings, inner, strict=True) if is_hole)]


def _corners(ring: NDArray[np.int32]) -> NDArray[np.float64]:
    """An (n, 2) closed ring of horizontal and vertical steps without repeated and straight-on vertices."""
    step = np.diff(ring, axis=0, prepend=ring[-1:])  # to each vertex
    moves = (step != 0).any(1)
    ring, along = ring[moves], step[moves, 0] != 0  # its last edge is horizontal
    return np.asarray(ring[along != np.append(along[1:], along[0])], np.float64)
