"""Predicts which window of the right photograph shows the same as a left window.

The prediction comes from the points of the level above or, without any, from the georeferences.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import PartnerConfig, TilesConfig
from zpm2.model import PointMatches
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.tiled import windows

Array = NDArray[np.float64]
MIN_DETERMINANT = 1e-6  # an affine map with a smaller determinant collapses the plane


@dataclass(frozen=True, eq=False)
class PartnerWindow:
    """A window of the right photograph, and its scale and rotation relative to the left one."""

    window: Window
    scale: float  # right px per left px
    turn: float  # radians from x to y, from the left to the right photograph


def coherent_points(points: PointMatches, noise: float, config: PartnerConfig) -> PointMatches:
    """The points that move with their neighbours.

    Enough of a point's nearest neighbours on the left must also be near it on the right: in the photographs' common
    scale, within `max_apart` times the distance on the left plus `noise` px. This works for any rotation and relief,
    and for scenes with more than one geometry.
    """
    n = len(points)
    if n <= config.neighbors:
        return points
    _, near = cKDTree(points.left).query(points.left, k=config.neighbors + 1)
    near = near[:, 1:]
    apart = np.linalg.norm(points.left[near] - points.left[:, None], axis=2)
    away = np.linalg.norm(points.right[near] - points.right[:, None], axis=2)
    spread = np.ptp(points.right, axis=0).max() / max(np.ptp(points.left, axis=0).max(), 1e-9)
    median = float(np.median(away / np.maximum(apart, 1e-9)))
    scale = min(median, config.max_spread * spread)  # wrong points lie far apart and make the median too large
    return points[(away <= config.max_apart * scale * apart + noise).sum(1) >= config.min_coherent * config.neighbors]


def affine_map(
    points: PointMatches, window: Window, noise: float, config: PartnerConfig, seed: int = 0
) -> Array | None:
    """(2, 3) affine map from left to right px in and around a window; None if the points do not agree on one.

    It is estimated by RANSAC from the points in the window; if these are few, from the points nearest to it.
    """
    x0, y0, x1, y1 = window
    inside = ((points.left >= [x0, y0]) & (points.left <= [x1, y1])).all(1)
    if inside.sum() < config.enough_points:
        out = np.maximum(np.maximum([x0, y0] - points.left, points.left - [x1, y1]), 0)
        inside = np.zeros(len(points), bool)
        inside[np.argsort((out**2).sum(1), kind="stable")[: config.enough_points]] = True
    if inside.sum() < config.min_points:
        return None
    cv2.setRNGSeed(seed)
    matrix, agree = cv2.estimateAffine2D(
        points.left[inside], points.right[inside], method=cv2.RANSAC, ransacReprojThreshold=noise
    )
    if matrix is None or agree.sum() < max(config.min_points, config.min_agreeing * inside.sum()):
        return None
    stretch = np.linalg.svd(matrix[:, :2], compute_uv=False)
    if stretch[0] > config.max_scale or stretch[1] < 1 / config.max_scale or np.linalg.det(matrix[:, :2]) <= 0:
        return None
    return np.asarray(matrix, np.float64)


def affine_by_georeference(window: Window, left: Source, right: Source, config: PartnerConfig) -> Array | None:
    """(2, 3) affine map of a window, from the georeferences of both photographs; None without them."""
    if not (left.placed and right.placed):
        return None
    x0, y0, x1, y1 = window
    x, y = np.meshgrid(np.linspace(x0, x1, 5), np.linspace(y0, y1, 5))
    own = np.c_[x.ravel(), y.ravel()]
    other = right.from_lon_lat(left.to_lon_lat(own))
    good = np.isfinite(other).all(1)
    if good.sum() < config.min_points:
        return None
    solution, *_ = np.linalg.lstsq(np.c_[own[good], np.ones(int(good.sum()))], other[good], rcond=None)
    return np.asarray(solution.T) if abs(np.linalg.det(solution.T[:, :2])) > MIN_DETERMINANT else None


def partner_window(
    window: Window,
    matrix: Array | None,
    points: PointMatches,
    size: tuple[int, int],
    margin: float,
    config: PartnerConfig,
) -> PartnerWindow | None:
    """The window of the right photograph to compare a left window with; None if there is none.

    It contains the left window mapped by `matrix` and the partners of its points, with a `margin` as a share of its
    sides. size: (width, height) of the right photograph, px.
    """
    if matrix is None:
        return None
    x0, y0, x1, y1 = window
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) @ matrix[:, :2].T + matrix[:, 2]
    low, high = corners.min(0), corners.max(0)
    photograph: Window = (0, 0, *size)
    mapped = _rounded(low, high)
    if windows.area(windows.common(mapped, photograph)) < config.min_shared * windows.area(mapped):
        return None
    inside = ((points.left >= [x0, y0]) & (points.left <= [x1, y1])).all(1)
    if inside.sum() >= config.min_points:  # relief displaces high and low parts of the scene
        reach = high - low
        ends = np.percentile(points.right[inside], [100 * config.outliers, 100 - 100 * config.outliers], axis=0)
        ends = np.clip(ends, low - config.max_relief * reach, high + config.max_relief * reach)
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    rim = margin * (high - low)
    linear = matrix[:, :2]
    u, _, v = np.linalg.svd(linear)
    rotation = u @ v
    return PartnerWindow(
        windows.common(_rounded(low - rim, high + rim), photograph),
        float(np.sqrt(abs(np.linalg.det(linear)))),
        float(np.arctan2(rotation[1, 0], rotation[0, 0])),
    )


def square_view(
    found: PartnerWindow, reduction: float, size: tuple[int, int], config: TilesConfig
) -> tuple[Window, tuple[int, int]]:
    """The window of a partner, made square, and the (width, height) px of its view.

    reduction: px of the left photograph per px of its view of `config.size` px. size: (width, height) of the right
    photograph, px.

    The right view shows things at the same size as the left view, unless the scales are nearly equal or the view would
    have to be enlarged. Its side is a multiple of a tile's side divided by `side_steps`, and at least a tile with the
    overlap on both sides, unless the photograph is smaller. Networks prepare for each size of image, so that a few
    sizes cost less than many.
    """
    tile, overlap, chosen = config.size, config.overlap, config.partner
    scale = 1.0 if abs(np.log(found.scale)) < np.log(chosen.same_scale) else found.scale
    reduction = max(1.0, reduction * scale)
    x0, y0, x1, y1 = found.window
    needed = max(tile * (1 + 2 * overlap), max(x1 - x0, y1 - y0) / reduction)
    side = tile // chosen.side_steps * int(np.ceil(needed / (tile // chosen.side_steps)))
    spans, shown = [], []
    for low, high, length in ((x0, x1, size[0]), (y0, y1, size[1])):
        span = min(length, round(side * reduction))
        start = min(max(0, (low + high - span) // 2), length - span)
        spans.append((start, start + span))
        shown.append(side if span < length else min(side, max(1, round(length / reduction))))
    return (spans[0][0], spans[1][0], spans[0][1], spans[1][1]), (shown[0], shown[1])


def _rounded(low: Array, high: Array) -> Window:
    (x0, y0), (x1, y1) = np.floor(low).astype(int), np.ceil(high).astype(int)
    return int(x0), int(y0), int(x1), int(y1)
