"""Homologous outlines: which point of the right exterior each point of the left one is, all around.

The left outline, carried into the right image by the pair's own map, and the right one are sampled at equal steps of
arc length. A cyclic alignment goes once around both at the same time and never steps back; it pairs the samples at the
least total cost: their distance, the angle between the outlines there, and, which says most about a point's place along
an outline, its distance to the epipolar line of the other. Where one outline has a bump that the other does not have,
the other waits; such places are known by their residual. In the end each pair settles between the samples.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from zpm2 import geometry
from zpm2.errors import Failed, InputError
from zpm2.model import Polygon, PolygonMatch

Array = NDArray[np.float64]
MIN_SAMPLES, MAX_SAMPLES = 12, 1500  # of an outline
EPIPOLAR = 2.0  # px that a pair 1 px off its epipolar line costs
DIRECTION = 4.0  # px that a pair costs where the outlines are at right angles
CHORD = 2  # samples ahead and behind, between which the direction of an outline is taken
WINDOW = 5  # pairs ahead and behind that must fit where an alignment starts
STARTS = 3  # that are tried at most


def with_outlines(
    matches: Sequence[PolygonMatch],
    pairs: Sequence[tuple[Polygon, Polygon]],
    maps: Array,
    fundamental: Array | Failed,
    step: float,
) -> list[PolygonMatch]:
    """The matches with their `outline`. `pairs` are the polygons and `maps` (n, 3, 3) the maps of n matches.

    `InputError` for a step (px) that is not above 0.
    """
    if not step > 0:
        raise InputError(f"outlines are sampled every {step} px: give a step above 0")
    known = None if isinstance(fundamental, Failed) else fundamental
    return [
        dataclasses.replace(match, outline=outline_correspondence(left.exterior, right.exterior, matrix, step, known))
        for match, (left, right), matrix in zip(matches, pairs, maps, strict=True)
    ]


def outline_correspondence(
    left: Array, right: Array, matrix: Array, step: float = 2.0, fundamental: Array | None = None
) -> Array:
    """(k, 5) x_left, y_left, x_right, y_right, residual: homologous points of two exteriors, once around both.

    `left` (n, 2) and `right` (m, 2) are rings in image px, `matrix` is the pair's map, right ~ matrix @ left, and
    `fundamental` F where it is known. Rows follow the left ring from its first vertex on; the right one is walked the
    way in which the carried left ring turns, so backwards where the map mirrors. Steps are `step` px of the right
    image, shorter around tiny rings, and longer around those of more than `MAX_SAMPLES` steps. `residual` is the
    distance in px of the right image between the carried left point and the right one. There is no row where the map
    tears or flattens the ring, or one is flat.
    """
    p = geometry.homogeneous(left) @ matrix.T
    depth = p[:, 2] * np.sign(p[:, 2].sum())
    if not np.isfinite(p).all() or (depth <= 1e-6 * depth.max()).any():
        return np.zeros((0, 5))
    warped = p[:, :2] / p[:, 2:]
    turns = _turn(warped) * _turn(right)
    if turns == 0:
        return np.zeros((0, 5))
    source, target = _Outline(warped, step), _Outline(right if turns > 0 else right[::-1], step)
    back = np.linalg.inv(matrix)
    epipolar = np.zeros((3, 3)) if fundamental is None else fundamental @ back
    s, t = _settle(source, target, align(_costs(source, target, epipolar)), epipolar)
    u, v = source.at(s), target.at(t)
    p = geometry.homogeneous(u) @ back.T
    return np.c_[p[:, :2] / p[:, 2:], v, np.linalg.norm(u - v, axis=1)]


def align(cost: Array) -> NDArray[np.int64]:
    """The (k, 2) pairs of rows and columns of a (p, q) `cost` that go once around both, p rows and q columns, at the
    least sum of costs that was found.

    From each pair to the next the row, the column, or both go on by one, also from the last to p and q after the first:
    indices run on beyond p and q and are to be taken modulo them. An alignment starts where a run of pairs is cheapest,
    and is repeated from where it fitted best itself, away from its start, as long as that makes it cheaper.
    """
    start = _surest(cost, np.arange(len(cost)), cost.argmin(1))
    best, path = np.inf, np.zeros((0, 2), np.int64)
    for _ in range(STARTS):
        total, found = _once_around(np.roll(cost, -start, axis=(0, 1)))
        if total >= best:
            break
        best, path = total, found + start
        away = path[len(path) // 4 : len(path) - len(path) // 4]
        start = _surest(cost, *away.T)
    return path


def _surest(cost: Array, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(2,) the pair (row, column), of those given, in the cheapest run of pairs."""
    ahead = np.arange(-WINDOW, WINDOW + 1)
    run = cost[(rows[:, None] + ahead) % cost.shape[0], (columns[:, None] + ahead) % cost.shape[1]]
    k = int(run.sum(1).argmin())
    return np.array([rows[k] % cost.shape[0], columns[k] % cost.shape[1]])


def _once_around(cost: Array) -> tuple[float, NDArray[np.int64]]:
    """The least sum of a path from (0, 0) to (p, q), which is (0, 0) again and not counted twice, and the path.

    Row after row: a pair is reached from the row before at some column, and along its own row from there on, which is
    a running minimum over the columns.
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
    """1 or -1, the way in which a ring turns; 0 for one that is flat."""
    x, y = (ring - ring[0]).T
    area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return 0 if abs(area) <= 1e-9 * float(np.ptp(ring, axis=0).max()) ** 2 else int(np.sign(area))


class _Outline:
    """A closed ring by arc length, with equidistant samples."""

    def __init__(self, ring: Array, step: float) -> None:
        self.ring = np.concatenate([ring, ring[:1]])
        edges = np.diff(self.ring, axis=0)
        self.along = np.append(0.0, np.cumsum(np.hypot(*edges.T)))  # px, at each vertex
        self.length = float(self.along[-1])
        count = int(np.clip(np.ceil(self.length / step), MIN_SAMPLES, MAX_SAMPLES))
        self.step = self.length / count
        s = np.linspace(0, self.length, count, endpoint=False)
        self.samples = self.at(s)
        chord = self.at(s + CHORD * self.step) - self.at(s - CHORD * self.step)
        self.directions = chord / np.maximum(np.hypot(*chord.T), 1e-300)[:, None]

    def at(self, s: Array) -> Array:
        """(..., 2) the points at arc lengths `s` (...), which may go on beyond the ring's length."""
        s = np.mod(s, self.length)
        return np.stack([np.interp(s, self.along, axis) for axis in self.ring.T], axis=-1)


def _costs(source: _Outline, target: _Outline, epipolar: Array) -> Array:
    """(p, q) of pairing each sample of one outline with each of the other. `epipolar` is F from the carried outline."""
    lines = geometry.epipolar_lines(epipolar, source.samples)
    off = np.abs(lines @ geometry.homogeneous(target.samples).T)
    turned = 1 - source.directions @ target.directions.T
    return cdist(source.samples, target.samples) + EPIPOLAR * off + DIRECTION * turned


def _settle(source: _Outline, target: _Outline, path: NDArray[np.int64], epipolar: Array) -> tuple[Array, Array]:
    """(k,), (k,) arc lengths of the pairs on both outlines, from the start of the source on, both ascending.

    In each pair the outline that went on stays at its sample, and the other one (the target, if both did) moves by up
    to half a step to where the two points agree best.
    """

    def price(u: Array, v: Array) -> Array:
        u, v = np.broadcast_arrays(u, v)
        off = geometry.epipolar_distance(epipolar, u.reshape(-1, 2), v.reshape(-1, 2)).reshape(u.shape[:-1])
        return np.asarray(np.linalg.norm(u - v, axis=-1) + EPIPOLAR * off)

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
    """(k,) arc lengths within half a step of `at` (k,) of which the points (k, tries, 2) have the least price."""
    reach = outline.step / 2
    for _ in range(3):
        tried = at[:, None] + reach * np.linspace(-1, 1, 9)
        at = tried[np.arange(len(at)), price(outline.at(tried)).argmin(1)]
        reach /= 4
    return at
