"""Homologous outlines: the point of the right exterior for each point of the left one, all around.

The left outline, warped into the right image by the pair's map, and the right one are sampled at equal steps of arc
length. A cyclic alignment goes once around both at the same time and never steps back. It pairs the samples at the
least total cost: their distance, the angle between the outlines, and the distance of one to the epipolar line of the
other, which says most about a point's position along an outline. If only one outline has a bump, the alignment waits on
the other, and the residuals are large there. Finally, each pair is refined between the samples.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from zpm2 import geometry
from zpm2.config import OutlineConfig
from zpm2.errors import Failed, InputError
from zpm2.model import Polygon, PolygonMatch
from zpm2.polygons.shapes import shoelace

Array = NDArray[np.float64]


def with_outlines(
    matches: Sequence[PolygonMatch],
    pairs: Sequence[tuple[Polygon, Polygon]],
    maps: Array,
    fundamental: Array | Failed,
    config: OutlineConfig,
    step: float,
) -> list[PolygonMatch]:
    """The matches with their `outline`. `pairs` are the polygons and `maps` (n, 3, 3) the maps of n matches.

    `InputError` for a step (px) that is not above 0.
    """
    if not step > 0:
        raise InputError(f"outlines are sampled every {step} px: give a step above 0")
    known = None if isinstance(fundamental, Failed) else fundamental
    return [
        dataclasses.replace(
            match, outline=outline_correspondence(left.exterior, right.exterior, matrix, config, step, known)
        )
        for match, (left, right), matrix in zip(matches, pairs, maps, strict=True)
    ]


def outline_correspondence(
    left: Array,
    right: Array,
    matrix: Array,
    config: OutlineConfig,
    step: float = 2.0,
    fundamental: Array | None = None,
) -> Array:
    """(k, 5) x_left, y_left, x_right, y_right, residual: homologous points of two exteriors, once around both.

    `left` (n, 2) and `right` (m, 2) are rings in image px, `matrix` is the pair's map, right ~ matrix @ left, and
    `fundamental` F where it is known. Rows follow the left ring from its first vertex on. The right ring runs in the
    direction of the warped left one, which is backwards where the map mirrors. Steps are `step` px of the right image,
    or what keeps the number of samples within the limits of `config`. `residual` is the distance between the warped
    left point and the right one, px of the right image. No rows where the warped ring crosses the horizon, or one is
    flat.
    """
    p = geometry.homogeneous(left) @ matrix.T
    depth = p[:, 2] * np.sign(p[:, 2].sum())
    if not np.isfinite(p).all() or (depth <= 1e-6 * depth.max()).any():
        return np.zeros((0, 5))
    warped = p[:, :2] / p[:, 2:]
    turns = _turn(warped) * _turn(right)
    if turns == 0:
        return np.zeros((0, 5))
    source, target = (_Outline(ring, step, config) for ring in (warped, right if turns > 0 else right[::-1]))
    back = np.linalg.inv(matrix)
    epipolar = np.zeros((3, 3)) if fundamental is None else fundamental @ back
    path = align(_costs(source, target, epipolar, config), config)
    s, t = _refine(source, target, path, epipolar, config.epipolar)
    u, v = source.at(s), target.at(t)
    p = geometry.homogeneous(u) @ back.T
    return np.c_[p[:, :2] / p[:, 2:], v, np.linalg.norm(u - v, axis=1)]


def align(cost: Array, config: OutlineConfig) -> NDArray[np.int64]:
    """The (k, 2) pairs of rows and columns of a (p, q) `cost` that go once around both, p rows and q columns, at the
    least sum of costs that was found.

    From each pair to the next, the row, the column, or both grow by one, also from the last pair to p and q after the
    first one: indices run on beyond p and q, take them modulo these. An alignment starts where a run of pairs is
    cheapest. It is repeated from its own cheapest run away from the start, as long as it gets cheaper.
    """
    start = _cheapest_run(cost, np.arange(len(cost)), cost.argmin(1), config.start_window)
    best, path = np.inf, np.zeros((0, 2), np.int64)
    for _ in range(config.max_starts):
        total, found = _once_around(np.roll(cost, -start, axis=(0, 1)))
        if total >= best:
            break
        best, path = total, found + start
        margin = int(config.restart_margin * len(path))
        away = path[margin : len(path) - margin]
        start = _cheapest_run(cost, away[:, 0], away[:, 1], config.start_window)
    return path


def _cheapest_run(cost: Array, rows: NDArray[np.int64], columns: NDArray[np.int64], window: int) -> NDArray[np.int64]:
    """(2,) the pair (row, column) in the middle of the cheapest run of 2 window + 1 pairs."""
    ahead = np.arange(-window, window + 1)
    run = cost[(rows[:, None] + ahead) % cost.shape[0], (columns[:, None] + ahead) % cost.shape[1]]
    k = int(run.sum(1).argmin())
    return np.array([rows[k] % cost.shape[0], columns[k] % cost.shape[1]])


def _once_around(cost: Array) -> tuple[float, NDArray[np.int64]]:
    """The least sum of a path from (0, 0) to (p, q), which is (0, 0) again and not counted twice, and the path.

    Row after row: the path to a pair enters the row at some column and goes on along the row, which is a running
    minimum over the columns.
    """
    p, q = cost.shape
    around = np.pad(cost, ((0, 1), (0, 1)), mode="wrap")
    around[p, q] = 0.0
    so_far = np.cumsum(around, axis=1)
    total = so_far.copy()
    for i in range(1, p + 1):
        from_above = total[i - 1].copy()
        np.minimum(from_above[1:], total[i - 1, :-1], out=from_above[1:])
        total[i] += np.minimum.accumulate(from_above - so_far[i] + around[i])
    return float(total[p, q]), _traced_back(total)


def _traced_back(total: Array) -> NDArray[np.int64]:
    """The path of least sums to the last pair of `total`, without that pair."""
    i, j = total.shape[0] - 1, total.shape[1] - 1
    path = []
    while i or j:
        if i and j:
            ways = total[i - 1, j - 1], total[i - 1, j], total[i, j - 1]
            way = ways.index(min(ways))
            i, j = i - (way < 2), j - (way != 1)
        else:
            i, j = max(i - 1, 0), max(j - 1, 0)
        path.append((i, j))
    return np.array(path[::-1], np.int64)


def _turn(ring: Array) -> int:
    """1 or -1, the direction of rotation of a ring; 0 for a flat one."""
    area = shoelace(ring - ring[0])
    return 0 if abs(area) <= 1e-9 * float(np.ptp(ring, axis=0).max()) ** 2 else int(np.sign(area))


class _Outline:
    """A closed ring by arc length, with equidistant samples."""

    def __init__(self, ring: Array, step: float, config: OutlineConfig) -> None:
        self.ring = np.concatenate([ring, ring[:1]])
        edges = np.diff(self.ring, axis=0)
        self.along = np.append(0.0, np.cumsum(np.hypot(*edges.T)))  # px, at each vertex
        self.length = float(self.along[-1])
        count = int(np.clip(np.ceil(self.length / step), config.min_samples, config.max_samples))
        self.step = self.length / count
        s = np.linspace(0, self.length, count, endpoint=False)
        self.samples = self.at(s)
        ahead = config.chord * self.step
        chord = self.at(s + ahead) - self.at(s - ahead)
        self.directions = chord / np.maximum(np.hypot(*chord.T), 1e-300)[:, None]

    def at(self, s: Array) -> Array:
        """(..., 2) the points at arc lengths `s` (...), which may go on beyond the ring's length."""
        s = np.mod(s, self.length)
        return np.stack([np.interp(s, self.along, axis) for axis in self.ring.T], axis=-1)


def _costs(source: _Outline, target: _Outline, epipolar: Array, config: OutlineConfig) -> Array:
    """(p, q) costs of pairing each sample of one outline with each of the other. `epipolar` is F of the warped outline
    and the right image."""
    lines = geometry.epipolar_lines(epipolar, source.samples)
    off = np.abs(lines @ geometry.homogeneous(target.samples).T)
    turned = 1 - source.directions @ target.directions.T
    return cdist(source.samples, target.samples) + config.epipolar * off + config.direction * turned


def _refine(
    source: _Outline, target: _Outline, path: NDArray[np.int64], epipolar: Array, weight: float
) -> tuple[Array, Array]:
    """(k,), (k,) arc lengths of the pairs on both outlines, from the start of the source on, both ascending.

    In each pair the outline that advanced stays at its sample. The other one (the target, if both advanced) moves by up
    to half a step to where distance plus `weight` times the distance to the epipolar line is least.
    """

    def price(u: Array, v: Array) -> Array:
        u, v = np.broadcast_arrays(u, v)
        off = geometry.epipolar_distance(epipolar, u.reshape(-1, 2), v.reshape(-1, 2)).reshape(u.shape[:-1])
        return np.asarray(np.linalg.norm(u - v, axis=-1) + weight * off)

    s, t = source.step * path[:, 0].astype(np.float64), target.step * path[:, 1].astype(np.float64)
    waits = np.diff(path[:, 0], prepend=-1) == 0
    u, v = source.at(s[~waits])[:, None], target.at(t[waits])[:, None]
    s[waits] = _slide(source, s[waits], lambda at: price(at, v))
    t[~waits] = _slide(target, t[~waits], lambda at: price(u, at))
    s, t = (np.minimum(np.maximum.accumulate(x), x[0] + o.length) for x, o in ((s, source), (t, target)))
    moves = np.append(True, (np.diff(s) > 1e-9) | (np.diff(t) > 1e-9))
    first = int(np.searchsorted(s[moves], source.length - 1e-9)) % int(moves.sum())
    return np.roll(s[moves], -first), np.roll(t[moves], -first)


def _slide(outline: _Outline, at: Array, price: Callable[[Array], Array]) -> Array:
    """(k,) arc lengths within half a step of `at` (k,) whose points have the least price, to a hundredth of a step: the
    best of 9 each in three rounds. `price` takes points (k, 9, 2)."""
    radius = outline.step / 2
    for _ in range(3):
        tried = at[:, None] + radius * np.linspace(-1, 1, 9)
        at = tried[np.arange(len(at)), price(outline.at(tried)).argmin(1)]
        radius /= 4
    return at
