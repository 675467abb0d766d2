"""The right photograph in the frame of the left picture, to be laid over it; transparent where it shows nothing."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError, cKDTree

from zpm2 import geometry
from zpm2.errors import Failed
from zpm2.model import PointMatches

NEIGHBORS = 8  # points that a point is compared with
STRAY = 0.06  # of the picture's longer side; a point that moves so much unlike its neighbours is a wrong one
ROUNDS = 20  # of weights
BEHIND = 0.01  # share of the points that may lie behind a camera
MOST = 0.8  # of the points, by which homographies are compared
FAR = 1e6  # px, of a point that a homography takes behind the horizon
MESH = 8  # px of the left picture between two points of the map, which is interpolated in between

Pixels = NDArray[np.uint8]
Array = NDArray[np.float64]


def by_homography(
    right: Pixels, homography: Array | Failed, scales: tuple[Array, Array], size: tuple[int, int]
) -> Pixels | Failed:
    """(h, w, 4) RGBA of `size`, aligned on the plane of the pair's homography; what lies off that plane is displaced.

    right: (h, w, 3) the picture of the right photograph. homography: (3, 3) p_right ~ H p_left, photograph px. scales:
    (2,) picture px per photograph px, of either side. size: (width, height) of the left picture.
    """
    if isinstance(homography, Failed):
        return homography
    left_scale, right_scale = (np.diag([*scale, 1.0]) for scale in scales)
    matrix = geometry.for_opencv(right_scale @ homography @ np.linalg.inv(left_scale))
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(_opaque(right), matrix, size, flags=how), np.uint8)


def rectifying(fundamental: Array | Failed, points: PointMatches) -> Array | Failed:
    """(3, 3) p_right ~ H p_left that keeps every point on its epipolar line and leaves the points the least to move
    along it: with it, the photographs are a rectified pair in the frame of the left one.

    The homographies that agree with F are [e']x F - e' v^T, of which v is fitted to the points by the sum of their
    distances, with weights that are renewed (Hartley and Zisserman, Multiple View Geometry, 2nd ed., 13.6). `Failed`
    without a fundamental matrix, with fewer than three points, or where the plane cannot be seen by both photographs.
    """
    if isinstance(fundamental, Failed):
        return fundamental
    if len(points) < 3:
        return Failed("there are fewer than three homologous points")
    unit = max(float(np.abs(points.left).max()), float(np.abs(points.right).max()), 1.0)
    to_unit, to_px = np.diag([1 / unit, 1 / unit, 1.0]), np.diag([unit, unit, 1.0])
    matrix = to_px @ fundamental @ to_px
    epipole = np.linalg.svd(matrix)[0][:, 2]  # the right one: F^T e' = 0
    turned = geometry.cross_matrix(epipole) @ (matrix / np.linalg.norm(matrix))
    left, right = geometry.homogeneous(points.left / unit), geometry.homogeneous(points.right / unit)
    free = np.cross(right, epipole)
    length = np.maximum(np.linalg.norm(free, axis=1), 1e-12)
    wanted = (np.cross(right, left @ turned.T) * free).sum(1) / length
    weights = np.ones(len(left))
    for _ in range(ROUNDS):
        v = np.linalg.lstsq(left * (length * weights)[:, None], wanted * weights, rcond=None)[0]
        found = turned - np.outer(epipole, v)
        depth = (left @ found.T)[:, 2]
        there = (left @ found.T)[:, :2] / np.where(depth == 0, 1e-12, depth)[:, None]
        away = np.linalg.norm(there - right[:, :2], axis=1)
        weights = 1 / np.sqrt(np.maximum(away, 1 / unit)) / np.maximum(np.abs(depth), 1e-12)
    if min((depth > 0).mean(), (depth < 0).mean()) > BEHIND:
        return Failed("no plane along the epipolar lines lies before both cameras")
    return np.asarray(to_px @ (found * np.sign(np.median(depth))) @ to_unit)


def within(homography: Array | Failed, points: PointMatches) -> float | None:
    """px of the right photograph within which a homography brings `MOST` of the left points to their partners; None
    without it or without points."""
    if isinstance(homography, Failed) or not len(points):
        return None
    away = np.linalg.norm(geometry.project(homography, points.left) - points.right, axis=1)
    return float(np.quantile(np.nan_to_num(away, nan=FAR), MOST))


def better(rectified: Array | Failed, plane: Array | Failed, points: PointMatches) -> tuple[Array | Failed, ...]:
    """Of both homographies the one that brings most points nearer to their partners; the other one as `Failed`."""
    first, second = within(rectified, points), within(plane, points)
    if first is None or second is None:
        return rectified, plane
    said = f"{100 * MOST:.0f} % of the homologous points lie within"
    if first < second:
        return rectified, Failed(
            f"the epipolar lines fit better ({said} {first:.1f} px, by the homography {second:.1f} px)"
        )
    return Failed(f"the homography fits better ({said} {second:.1f} px, by the epipolar lines {first:.1f} px)"), plane


def by_points(
    right: Pixels, points: PointMatches, scales: tuple[Array, Array], size: tuple[int, int]
) -> Pixels | Failed:
    """Aligned on the homologous points and, in the triangles between them, in proportion; for any scene.

    Points that move unlike their neighbours are left out. Arguments are those of `by_homography`. `Failed` with fewer
    than three points that span an area.
    """
    left, there = points.left * scales[0], points.right * scales[1]
    alike = _alike(left, there, STRAY * max(size))
    left, there = left[alike], there[alike]
    try:
        between = LinearNDInterpolator(left, there)
    except (QhullError, ValueError):
        return Failed("the homologous points span no area" if len(left) else "there are no homologous points")
    width, height = size
    columns, rows = (max(2, -(-length // MESH)) for length in size)
    x, y = np.meshgrid((np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows)
    coarse = between(x, y)
    beyond = ~np.isfinite(coarse).all(2)
    nearest = cKDTree(left).query(np.c_[x[beyond], y[beyond]])[1]
    coarse[beyond] = np.c_[x[beyond], y[beyond]] + (there - left)[nearest]  # for mesh points next to the outermost ones
    full = cv2.resize(coarse.astype(np.float32) - 0.5, size, interpolation=cv2.INTER_LINEAR)  # OpenCV: centres from 0
    rgba = np.asarray(cv2.remap(_opaque(right), full, None, cv2.INTER_LINEAR), np.uint8)
    within = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(within, np.rint(cv2.convexHull(left.astype(np.float32))).astype(np.int32), 255)
    rgba[within == 0] = 0
    return rgba


def _alike(left: Array, there: Array, most: float) -> NDArray[np.bool_]:
    """(n,) the points whose move is within `most` px of the median of their neighbours' moves."""
    if len(left) <= NEIGHBORS:
        return np.ones(len(left), bool)
    moves = there - left
    near = cKDTree(left).query(left, k=NEIGHBORS + 1)[1][:, 1:]
    return np.asarray(np.linalg.norm(moves - np.median(moves[near], axis=1), axis=1) <= most)


def _opaque(rgb: Pixels) -> Pixels:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])
