"""Where the other photograph shows what a window shows: from the points of the level above, else from georeferences."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.model import PointMatches
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.tiled import windows

Array = NDArray[np.float64]
MOST_SPREAD = 2.0  # of the scale that the extents of all points in both photographs lead to
NEIGHBORS = 8  # of a point, half of which must have moved with it
LEAST, ENOUGH = 12, 60  # points for an affine map; where a window has fewer than enough, the nearest ones help
NOISE = 0.02  # of a window's side: how far relief moves points from an affine map
MOST_SCALE = 8.0  # right px per left px, or the other way round, beyond which a map is no map
STEPS = 4  # in a tile's side, of which the side of a view is a multiple
HARDLY = 1.1  # right px per left px up to which both photographs are seen alike
SEEN = 0.02  # share of a mapped window that must lie in the other photograph


@dataclass(frozen=True, eq=False)
class Partner:
    """A window of the right photograph, and how it lies to the left one."""

    window: Window
    scale: float  # right px per left px
    turn: float  # radians from x to y, from the left to the right photograph


def coherent(points: PointMatches, noise: float) -> PointMatches:
    """The points that move with their neighbours: at least half of the 8 nearest ones on the left are as near on the
    right, in the photographs' common scale, up to twice the distance and `noise` px. Holds for any turn and relief, and
    for scenes with more than one geometry."""
    n = len(points)
    if n <= NEIGHBORS:
        return points
    _, near = cKDTree(points.left).query(points.left, k=NEIGHBORS + 1)
    near = near[:, 1:]
    apart = np.linalg.norm(points.left[near] - points.left[:, None], axis=2)
    away = np.linalg.norm(points.right[near] - points.right[:, None], axis=2)
    spread = np.ptp(points.right, axis=0).max() / max(np.ptp(points.left, axis=0).max(), 1e-9)
    scale = min(float(np.median(away / np.maximum(apart, 1e-9))), MOST_SPREAD * spread)  # what is random is far apart
    return points[(away <= 2 * scale * apart + noise).sum(1) * 2 >= NEIGHBORS]


def affine(points: PointMatches, window: Window, noise: float) -> Array | None:
    """(2, 3) affine map from left to right px in and around a window: by RANSAC from the points in it, and where these
    are few from those nearest to it; None where they do not agree on one."""
    x0, y0, x1, y1 = window
    inside = ((points.left >= [x0, y0]) & (points.left <= [x1, y1])).all(1)
    if inside.sum() < ENOUGH:
        out = np.maximum(np.maximum([x0, y0] - points.left, points.left - [x1, y1]), 0)
        inside = np.zeros(len(points), bool)
        inside[np.argsort((out**2).sum(1), kind="stable")[:ENOUGH]] = True
    if inside.sum() < LEAST:
        return None
    cv2.setRNGSeed(0)
    matrix, agree = cv2.estimateAffine2D(
        points.left[inside], points.right[inside], method=cv2.RANSAC, ransacReprojThreshold=noise, maxIters=2000
    )
    if matrix is None or agree.sum() < max(LEAST, 0.3 * inside.sum()):
        return None
    stretch = np.linalg.svd(matrix[:, :2], compute_uv=False)
    if stretch[0] > MOST_SCALE or stretch[1] < 1 / MOST_SCALE or np.linalg.det(matrix[:, :2]) <= 0:
        return None
    return np.asarray(matrix, np.float64)


def by_georeference(window: Window, left: Source, right: Source) -> Array | None:
    """(2, 3) affine map of a window from where both photographs lie on the ground; None where one does not say."""
    if not (left.placed and right.placed):
        return None
    x0, y0, x1, y1 = window
    x, y = np.meshgrid(np.linspace(x0, x1, 5), np.linspace(y0, y1, 5))
    own = np.c_[x.ravel(), y.ravel()]
    other = right.from_lon_lat(left.to_lon_lat(own))
    good = np.isfinite(other).all(1)
    if good.sum() < LEAST:
        return None
    solution, *_ = np.linalg.lstsq(np.c_[own[good], np.ones(int(good.sum()))], other[good], rcond=None)
    return np.asarray(solution.T) if abs(np.linalg.det(solution.T[:, :2])) > 1e-6 else None


def partner(
    window: Window, matrix: Array | None, points: PointMatches, size: tuple[int, int], margin: float
) -> Partner | None:
    """What of the right photograph of `size` (width, height) px to compare a left window with; None for nothing.

    The window mapped by `matrix`, and where its own points lead, with a `margin` in its sides.
    """
    if matrix is None:
        return None
    x0, y0, x1, y1 = window
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) @ matrix[:, :2].T + matrix[:, 2]
    low, high = corners.min(0), corners.max(0)
    photograph: Window = (0, 0, *size)
    mapped = _rounded(low, high)
    if windows.area(windows.common(mapped, photograph)) < SEEN * windows.area(mapped):
        return None
    inside = ((points.left >= [x0, y0]) & (points.left <= [x1, y1])).all(1)
    if inside.sum() >= LEAST:  # relief: what stands high or low is seen elsewhere
        reach = high - low
        ends = np.clip(np.percentile(points.right[inside], [2, 98], axis=0), low - reach / 4, high + reach / 4)
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    rim = margin * (high - low)
    linear = matrix[:, :2]
    u, _, v = np.linalg.svd(linear)
    rotation = u @ v
    return Partner(
        windows.common(_rounded(low - rim, high + rim), photograph),
        float(np.sqrt(abs(np.linalg.det(linear)))),
        float(np.arctan2(rotation[1, 0], rotation[0, 0])),
    )


def framed(
    found: Partner, reduction: float, tile: int, overlap: float, size: tuple[int, int]
) -> tuple[Window, tuple[int, int]]:
    """The window of a partner, made square, and the (width, height) px of its view.

    `reduction` is that of the left view of `tile` px; the view of the right photograph, of `size` px, has the same
    scale, but for what is hardly another one, and never enlarges. Its side is a multiple of a quarter of `tile`, and at
    least `tile` with `overlap` on both sides, except where the photograph is smaller: networks keep what they prepare
    for each size of image that they see, and a few sizes cost less than many.
    """
    scale = 1.0 if abs(np.log(found.scale)) < np.log(HARDLY) else found.scale
    reduction = max(1.0, reduction * scale)
    x0, y0, x1, y1 = found.window
    needed = max(tile * (1 + 2 * overlap), max(x1 - x0, y1 - y0) / reduction)
    side = tile // STEPS * int(np.ceil(needed / (tile // STEPS)))
    spans, view = [], []
    for low, high, length in ((x0, x1, size[0]), (y0, y1, size[1])):
        span = min(length, round(side * reduction))
        start = min(max(0, (low + high - span) // 2), length - span)
        spans.append((start, start + span))
        view.append(side if span < length else min(side, max(1, round(length / reduction))))
    return (spans[0][0], spans[1][0], spans[0][1], spans[1][1]), (view[0], view[1])


def _rounded(low: Array, high: Array) -> Window:
    (x0, y0), (x1, y1) = np.floor(low).astype(int), np.ceil(high).astype(int)
    return int(x0), int(y0), int(x1), int(y1)
