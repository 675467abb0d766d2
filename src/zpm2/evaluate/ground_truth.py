"""Which polygons correspond: from disparity, from depth and pose, or from a homography.

Two protocols. `overlap` and `mutual_best` are dense: polygons are compared over all points that both images see, as a
mask is compared with a mask; our tables use these. `center_pairs` is the paper's (its section "Metric for
polygon matching", Eq. gt): the centres of two polygons must project onto each other.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from zpm2 import geometry
from zpm2.errors import InputError
from zpm2.evaluate.label_raster import LabelRaster, Rows, rasterize_labels
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, HomographyTruth, Truth
from zpm2.formats.maps import read_disparity, read_map
from zpm2.model import Polygon, PolygonArrays

# Constants of the protocol: they decide which matches are judged, so other values give other scores.
MIN_POINTS = 20  # co-visible points in either polygon, below which a pair cannot be judged
MIN_DENSITY = 0.25  # of the average number of co-visible points per pixel of the left image, likewise
OCCLUSION_DISPARITY = 1.0  # px of disparity by which a nearer point hides another
OCCLUSION_DEPTH = 1.02  # ratio of depths from which on the nearer point hides the other
DEPTH_TOLERANCE = (0.03, 0.02)  # share of the depth, and m, by which a point may miss the right image's depth map
CENTER_TOLERANCE = 0.1  # lambda of the paper, as a share of a polygon's side sqrt(area)
_BLOCK = 1 << 20  # points at once, to bound the memory

Array = NDArray[np.float64]
_Projected = tuple[Array, Array, Array]  # left (k, 2), right (k, 2), nearness (k,)
_Project = Callable[[slice], _Projected]  # of a slice of image rows


@dataclass(frozen=True, eq=False)
class CoVisible:
    """Points that both images see: one for each pixel of the left image whose truth is known and not hidden."""

    left: Array  # (n, 2) image px: pixel centres
    right: Array  # (n, 2) image px

    def __len__(self) -> int:
        return len(self.left)

    def swapped(self) -> "CoVisible":
        """The same points, seen from the other image."""
        return CoVisible(self.right, self.left)


def covisible(truth: Truth, left_size: tuple[int, int], right_size: tuple[int, int]) -> CoVisible:
    """The points that both images see. Sizes are (width, height) px of the images.

    Points that leave the right image do not count, and neither do those that are hidden there: see `from_disparity` and
    `from_depth` for the rule. `InputError` as from `read_map` for a file that cannot be used, and for a truth that
    does not cover single points (a pose without depth).
    """
    if isinstance(truth, DisparityTruth):
        return from_disparity(read_disparity(truth.file, left_size, truth.scale, truth.sign), right_size)
    if isinstance(truth, DepthTruth):
        depth, other = truth.files
        right_depth = None if other is None else _depth(other, right_size, truth.scale)
        return from_depth(_depth(depth, left_size, truth.scale), truth, right_size, right_depth)
    if isinstance(truth, HomographyTruth):
        return from_homography(truth.matrix, left_size, right_size)
    raise InputError("a pose without depth does not say which points correspond: judge this pair by its pose error")


def _depth(file: Path, size: tuple[int, int], scale: float) -> NDArray[np.float32]:
    """(h, w) metres on the pixels of an image of `size`. A sensor's depth map may have another resolution (ScanNet:
    640 x 480 for 1296 x 968); with the same proportions, to 1 %, each pixel takes the value that lies at its place."""
    values = read_map(file, None, scale)
    (width, height), (own_height, own_width) = size, values.shape
    if (own_width, own_height) == size or abs(own_width * height / (own_height * width) - 1) > 0.01:
        return read_map(file, size, scale)
    rows = (np.arange(height) + 0.5) * own_height / height
    columns = (np.arange(width) + 0.5) * own_width / width
    return values[np.ix_(rows.astype(np.intp), columns.astype(np.intp))]


def from_disparity(disparity: NDArray[np.floating], right_size: tuple[int, int]) -> CoVisible:
    """Co-visible points of a rectified pair: left (x, y) is right (x - d, y).

    disparity: (h, w) px of the left image, not finite where unknown. A point is hidden if another one in the same pixel
    of the right image has a disparity that is greater by more than 1 px, or smaller where disparities are negative (the
    right photograph comes first).
    """
    below, above = np.count_nonzero(disparity < 0), np.count_nonzero(disparity > 0)
    toward = -1.0 if below > above else 1.0  # the sign of disparities of what is near

    def project(rows: slice) -> _Projected:
        left, d = _known(disparity, rows)
        right = left.copy()
        right[:, 0] -= d
        return left, right, toward * d

    return _unhidden(project, disparity.shape, right_size, lambda near, nearest: near >= nearest - OCCLUSION_DISPARITY)


def from_depth(
    depth: NDArray[np.floating],
    cameras: DepthTruth,
    right_size: tuple[int, int],
    right_depth: NDArray[np.floating] | None = None,
) -> CoVisible:
    """Co-visible points of two calibrated views; only the cameras of `cameras` are used.

    depth, right_depth: (h, w) metres along the optical axis, not finite where unknown. A point is hidden if it misses
    the right depth map by more than 3 % + 2 cm, or the map has no value there; without a map, if another point in the
    same pixel of the right image is nearer by more than 2 %.
    """
    left_intrinsics, right_intrinsics = cameras.intrinsics
    rotate = right_intrinsics @ cameras.pose[:3, :3] @ np.linalg.inv(left_intrinsics)
    shift = right_intrinsics @ cameras.pose[:3, 3]

    def project(rows: slice) -> _Projected:
        left, z = _known(depth, rows)
        seen = np.c_[left, np.ones(len(left))] @ rotate.T * z[:, None] + shift
        front = seen[:, 2] > 1e-6
        left, seen = left[front], seen[front]
        return left, seen[:, :2] / seen[:, 2:], -seen[:, 2]

    if right_depth is None:
        return _unhidden(project, depth.shape, right_size, lambda near, nearest: near >= nearest * OCCLUSION_DEPTH)

    def agreeing(rows: slice) -> _Projected:
        left, right, nearness = _inside(project(rows), right_size)
        expected = right_depth.ravel()[_pixel(right, right_size)]
        share, metres = DEPTH_TOLERANCE
        return _kept((left, right, nearness), np.abs(nearness + expected) < share * expected + metres)

    return _gathered(agreeing, depth.shape, right_size)


def from_homography(matrix: Array, left_size: tuple[int, int], right_size: tuple[int, int]) -> CoVisible:
    """Co-visible points of a plane, or of a camera that only turned: those that fall into the right image."""
    everywhere = np.broadcast_to(np.zeros(1), left_size[::-1])

    def project(rows: slice) -> _Projected:
        left, nearness = _known(everywhere, rows)
        return left, geometry.project(matrix, left), nearness

    return _gathered(project, everywhere.shape, right_size)


def _known(values: NDArray[np.floating], rows: slice) -> tuple[Array, Array]:
    """(k, 2) px centres and (k,) values of the finite pixels in some rows."""
    y, x = np.nonzero(np.isfinite(values[rows]))
    return np.c_[x + 0.5, y + (rows.start + 0.5)], values[rows][y, x].astype(np.float64)


def _unhidden(
    project: _Project,
    shape: tuple[int, ...],
    right_size: tuple[int, int],
    seen: Callable[[Array, Array], NDArray[np.bool_]],
) -> CoVisible:
    """Projected points that pass a z-buffer of the right image's pixels: `seen(nearness, greatest nearness there)`."""
    nearest = np.full(right_size[0] * right_size[1], -np.inf)
    for rows in _blocks(shape):
        _, right, nearness = _inside(project(rows), right_size)
        np.maximum.at(nearest, _pixel(right, right_size), nearness)

    def visible(rows: slice) -> _Projected:
        left, right, nearness = _inside(project(rows), right_size)
        return _kept((left, right, nearness), seen(nearness, nearest[_pixel(right, right_size)]))

    return _gathered(visible, shape, right_size)


def _gathered(project: _Project, shape: tuple[int, ...], right_size: tuple[int, int]) -> CoVisible:
    left, right = np.empty((shape[0] * shape[1], 2)), np.empty((shape[0] * shape[1], 2))
    n = 0
    for rows in _blocks(shape):
        here, there, _ = _inside(project(rows), right_size)
        left[n : n + len(here)], right[n : n + len(here)] = here, there
        n += len(here)
    return CoVisible(left[:n], right[:n])


def _blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    step = max(1, _BLOCK // shape[1])
    return (slice(start, min(start + step, shape[0])) for start in range(0, shape[0], step))


def _inside(projected: _Projected, size: tuple[int, int]) -> _Projected:
    x, y = projected[1].T
    return _kept(projected, (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1]))


def _kept(projected: _Projected, chosen: NDArray[np.bool_]) -> _Projected:
    if chosen.all():
        return projected
    left, right, nearness = (np.compress(chosen, values, axis=0) for values in projected)
    return left, right, nearness


def _pixel(points: Array, size: tuple[int, int]) -> NDArray[np.intp]:
    """(k,) index, row by row, of the pixel under each point; all points lie in the image."""
    return points[:, 1].astype(np.intp) * size[0] + points[:, 0].astype(np.intp)


@dataclass(frozen=True, eq=False)
class Overlap:
    """How n left and n' right polygons cover the co-visible points: IoU(i, j) = #(both) / #(either).

    Pairs of polygons are (k, 2) rows: `left[i]` with `right[j]`, whatever their ids.
    """

    left: LabelRaster
    right: LabelRaster
    counts: scipy.sparse.csr_array  # (m, m') co-visible points in each pair of cells

    @property
    def points(self) -> int:
        """Number of co-visible points."""
        return int(self.counts.sum())

    @cached_property
    def seen(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(n,) and (n',) co-visible points in each left and each right polygon."""
        return self.left.members @ self.counts.sum(axis=1), self.right.members @ self.counts.sum(axis=0)

    @cached_property
    def _both(self) -> tuple[Rows, NDArray[np.int64]]:
        both = (self.left.members @ self.counts @ self.right.members.T).tocoo()
        rows = np.stack([both.row, both.col], axis=1).astype(np.intp)
        order = np.lexsort((rows[:, 1], rows[:, 0]))
        return rows[order], both.data[order].astype(np.int64)

    @property
    def meeting(self) -> Rows:
        """(k, 2) all pairs that have a co-visible point in common, by row, then by column."""
        return self._both[0]

    def both(self, pairs: Rows) -> NDArray[np.int64]:
        """(k,) co-visible points in both polygons of each of (k, 2) pairs."""
        meeting, counts = self._both
        keys, wanted = (p[:, 0] * len(self.right.pixels) + p[:, 1] for p in (meeting, pairs))
        at = np.searchsorted(keys, wanted)
        found = np.append(keys, -1)[at] == wanted
        return np.where(found, np.append(counts, 0)[at], 0)

    def either(self, pairs: Rows) -> NDArray[np.int64]:
        """(k,) co-visible points in one or both polygons of each pair."""
        return np.asarray(self.seen[0][pairs[:, 0]] + self.seen[1][pairs[:, 1]] - self.both(pairs))

    def iou(self, pairs: Rows) -> Array:
        """(k,) 0..1 of each pair; 0 where none of its points is seen by both images."""
        return np.asarray(self.both(pairs) / np.maximum(self.either(pairs), 1))

    def enough(self, pairs: Rows) -> NDArray[np.bool_]:
        """(k,) whether a pair can be judged: at least 20 points in either polygon, and at least a quarter as many for
        each pixel of the larger one as the left image has on average. Where the truth is sparser, as around a tree of
        which only the trunk was measured, the pair would be judged by a small part of it."""
        larger = np.maximum(self.left.pixels[pairs[:, 0]], self.right.pixels[pairs[:, 1]])
        least = MIN_DENSITY * self.points / self.left.labels.size * larger
        return np.asarray(self.either(pairs) >= np.maximum(MIN_POINTS, least))


def overlap(
    left: Sequence[Polygon],
    right: Sequence[Polygon],
    points: CoVisible,
    left_size: tuple[int, int],
    right_size: tuple[int, int],
) -> Overlap:
    """The overlaps of all left with all right polygons over the co-visible points. Sizes are (width, height) px."""
    first, second = rasterize_labels(left, *left_size), rasterize_labels(right, *right_size)
    shape = len(first.sizes), len(second.sizes)
    counts = scipy.sparse.csr_array(shape, dtype=np.int64)
    for start in range(0, len(points), _BLOCK):
        block = slice(start, start + _BLOCK)
        cells = first.at(points.left[block]), second.at(points.right[block])
        counts = counts + scipy.sparse.csr_array((np.ones(len(cells[0]), np.int64), cells), shape=shape)
    return Overlap(first, second, counts)


def mutual_best(overlaps: Overlap, t: float) -> Rows:
    """(k, 2) the dense ground truth: pairs that are each other's best by IoU, reach IoU t and can be judged.

    By ascending left row; of equally good partners the first counts. The truth of a greater t is part of that of a
    smaller one.
    """
    pairs = overlaps.meeting
    iou = overlaps.iou(pairs)
    by_left = np.lexsort((pairs[:, 1], -iou, pairs[:, 0]))
    by_right = np.lexsort((pairs[:, 0], -iou, pairs[:, 1]))
    first_left = by_left[np.unique(pairs[by_left, 0], return_index=True)[1]]
    first_right = by_right[np.unique(pairs[by_right, 1], return_index=True)[1]]
    best = np.intersect1d(first_left, first_right)
    best = best[iou[best] >= t]
    found = pairs[best]
    return found[overlaps.enough(found)]


def center_pairs(
    left: Sequence[Polygon],
    right: Sequence[Polygon],
    points: CoVisible,
    left_size: tuple[int, int],
    right_size: tuple[int, int],
    tolerance: float = CENTER_TOLERANCE,
) -> Rows:
    """(k, 2) the paper's ground truth (Eq. gt): pairs of rows whose centres project onto each other, both ways.

    The centre of each left polygon is projected into the right image, the centre of each right one into the left. A
    pair is true if each projected centre lies within lambda of the partner's centre, and no other partner's centre is
    nearer to it (the paper's "bidirectional consistency check").

    The paper prints |x - x'| <= lambda without a unit, and "the confidence level lambda is 0.1". As 0.1 px it cannot
    be met: the centres of two separately segmented outlines of one thing differ by whole pixels. Read here as a share
    of the polygon's side, sqrt(area), in the image where the distance is measured: a polygon of 100 x 100 px may be off
    by 10 px, which is about an IoU of 0.8 for a shifted square. A centre that lies on an occluded or unknown place
    matches nothing, and polygons with one centre but of different size (a ring and its filling) are not told apart:
    these are why the dense protocol is the one in our tables.
    """
    first, second = PolygonArrays(left), PolygonArrays(right)
    there = _apart(_project_centers(first.centers, points, left_size), second, tolerance)
    back = _apart(_project_centers(second.centers, points.swapped(), right_size), first, tolerance).T
    if not there.size:
        return np.zeros((0, 2), np.intp)
    near = (there <= 1) & (back <= 1)
    distance = np.where(near, there + back, np.inf)
    partner, owner = distance.argmin(axis=1), distance.argmin(axis=0)
    rows = np.flatnonzero(near.any(axis=1) & (owner[partner] == np.arange(len(left))))
    return np.stack([rows, partner[rows]], axis=1)


def _apart(projected: Array, polygons: PolygonArrays, tolerance: float) -> Array:
    """(k, n) distances of projected centres to polygons' centres, 1 = just within the tolerance; inf if unknown."""
    distance = cdist(projected, polygons.centers)
    return np.where(np.isnan(distance), np.inf, distance / (tolerance * np.sqrt(polygons.areas)))


def _project_centers(centers: Array, points: CoVisible, size: tuple[int, int], reach: int = 2) -> Array:
    """(n, 2) where centres lie in the other image, by the nearest co-visible point within `reach` px; NaN if none."""
    width, height = size
    index = np.full(width * height, -1, np.int32)  # of the last point in each pixel
    for start in range(0, len(points), _BLOCK):
        block = points.left[start : start + _BLOCK]
        index[_pixel(np.minimum(block, [width - 1, height - 1]), size)] = np.arange(start, start + len(block))
    around = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    pixels = np.floor(centers).astype(np.intp)[:, None] + around
    inside = ((pixels >= 0) & (pixels < size)).all(axis=2)
    found = np.where(inside, index[np.where(inside, pixels[..., 1] * width + pixels[..., 0], 0)], -1)
    if not len(points):
        return np.full(centers.shape, np.nan)
    off = np.where(found >= 0, np.linalg.norm(points.left[found] - centers[:, None], axis=2), np.inf)
    nearest = np.take_along_axis(found, off.argmin(axis=1)[:, None], axis=1)[:, 0]
    moved = points.right[nearest] + centers - points.left[nearest]
    return np.where(np.isfinite(off.min(axis=1))[:, None], moved, np.nan)
