"""Outlines as a fixed number of samples, the input of both shape descriptors. Holes are ignored."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def outline(ring: Array) -> Array:
    """The closed (v, 2) ring in a frame of its own: its centre is the origin and its length the unit.

    The centre is that of the line, not of the area, as slivers have almost none. The first vertex is the one farthest
    from the centre, of several the one most to the left, then the uppermost, whichever came first in `ring`. Repeated
    vertices are left out.
    """
    ring = ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]
    ahead = np.roll(ring, -1, axis=0) - ring
    step = np.hypot(*ahead.T)
    ring = (ring - np.average(ring + ahead / 2, axis=0, weights=step)) / step.sum()
    x, y = np.round(ring, 9).T
    start = np.lexsort((y, x, -np.round(np.hypot(*ring.T), 9)))[0]
    return np.asarray(np.roll(ring, -start, axis=0))


def sample(ring: Array, n: int) -> Array:
    """(n, 2) samples of a closed (v, 2) ring, equally far from each other along it, from its first vertex on."""
    closed = np.concatenate([ring, ring[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    where = np.arange(n) * along[-1] / n
    return np.asarray(np.c_[np.interp(where, along, closed[:, 0]), np.interp(where, along, closed[:, 1])])


def tangents(samples: Array) -> Array:
    """(..., n) direction of the outline at each of (..., n, 2) samples, radians: that from the last to the next one."""
    ahead = np.roll(samples, -1, axis=-2) - np.roll(samples, 1, axis=-2)
    return np.asarray(np.arctan2(ahead[..., 1], ahead[..., 0]))
