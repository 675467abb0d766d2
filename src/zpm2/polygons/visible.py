"""The parts of polygons that both photographs can show, where a border of a photograph cuts a polygon off.

A region that the border cuts in one photograph may go on in the other. The whole polygons then differ, but not by
disagreement. A border excuses only what lies beyond it, and only of a partner that touches it: a polygon that ends
inside its photograph ends there.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]
Size = tuple[int, int]  # width, height, px
# a x + b y + c >= 0 inside, c = share of (width, height) + offset: left, upper, right and lower border
_NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def touched(shapes: Shapes, size: Size, border: float) -> NDArray[np.bool_]:
    """(n, 4) whether polygons reach the left, upper, right and lower border of a photograph, or come as near as
    `border`, a share of its longer side."""
    near = border * max(size)
    low, high = np.split(shapely.bounds(shapes).reshape(-1, 4), 2, axis=1)
    return np.asarray(np.c_[low <= near, high >= np.array(size) - near])


def within_borders(shapes: Shapes, maps: Array, size: Size, sides: NDArray[np.bool_], inside: Array) -> Shapes:
    """(n,) polygons, each cut at the borders `sides` (n, 4) of a photograph of another frame.

    `maps` (n, 3, 3) lead from that frame to the polygons'; `inside` (n, 2) are points of that frame within the
    photograph, by which the side that it shows is told. Polygons that no border concerns stay the same objects.
    """
    result = np.array(shapes, object)
    offsets = np.array([0.0, 0.0, size[0], size[1]])
    row, side = np.nonzero(sides & ~shapely.is_empty(result)[:, None])
    if len(row) == 0:
        return result
    a, b, c = (maps[row, k] for k in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)  # the inverse transposed, scaled
    lines = np.einsum("nij,nj->ni", cofactors, np.c_[_NORMALS[side], offsets[side]])
    at = geometry.linearised(maps[row], inside[row])[0]
    lines *= np.where((lines * geometry.homogeneous(at)).sum(1) < 0, -1.0, 1.0)[:, None]
    reach = 4 * (np.abs(shapely.bounds(result[row])).max(1) + np.abs(at).max(1) + 1.0)
    half = _half_planes(lines, at, reach)
    for k in range(4):
        chosen = side == k
        result[row[chosen]] = shapely.intersection(result[row[chosen]], half[chosen])
    return result


def co_visible(
    warped: Shapes, right: Shapes, maps: Array, left: Shapes, sizes: tuple[Size, Size], border: float
) -> tuple[Shapes, Shapes]:
    """Of c pairs, the parts of the warped left and of the right polygon that both photographs can show.

    `maps` (c, 3, 3) lead from left to right, `warped` are the polygons `left` mapped by them, `sizes` those of the left
    and the right photograph, `border` as in `touched`.
    """
    centers = shapely.get_coordinates(shapely.centroid(left))
    identity = np.broadcast_to(np.eye(3), maps.shape)
    inside = np.broadcast_to(np.array(sizes[1]) / 2, centers.shape)
    cut = within_borders(warped, identity, sizes[1], touched(right, sizes[1], border), inside)
    return cut, within_borders(right, maps, sizes[0], touched(left, sizes[0], border), centers)


def _half_planes(lines: Array, near: Array, reach: Array) -> Shapes:
    """(n,) squares that fill the half-planes a x + b y + c >= 0 of (n, 3) lines as far as `reach` (n,) px around the
    points `near` (n, 2)."""
    norm = np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    normal = lines[:, :2] / np.maximum(norm, 1e-300)
    foot = near - (normal * near).sum(1, keepdims=True) * normal - lines[:, 2:] / np.maximum(norm, 1e-300) * normal
    along, ahead = reach[:, None] * np.c_[-normal[:, 1], normal[:, 0]], 2 * reach[:, None] * normal
    return np.asarray(
        shapely.polygons(np.stack([foot - along, foot + along, foot + along + ahead, foot - along + ahead], 1))
    )
