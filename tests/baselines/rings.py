"""Outlines for the tests of the baselines."""

import numpy as np
import shapely
from hypothesis import strategies as st

L_SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
U_SHAPE = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], float)


def star(rng, n, center=(0.0, 0.0), size=10.0):
    """(n, 2) ring of a simple polygon around `center`, without symmetries, mostly concave."""
    angle = (np.arange(n) + rng.uniform(-0.35, 0.35, n)) * 2 * np.pi / n
    return np.array(center) + size * rng.uniform(0.3, 1.0, (n, 1)) * np.c_[np.cos(angle), np.sin(angle)]


def hull(rng, n):
    """The convex hull of n random points as a ring that turns like those of `star`."""
    shape = shapely.MultiPoint(rng.uniform(0, 10, (n, 2))).convex_hull
    return np.array(shapely.geometry.polygon.orient(shape).exterior.coords)[:-1]


def turned(ring, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return ring @ np.array([[c, s], [-s, c]])


generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)
stars = st.builds(star, generators, st.integers(5, 40))
hulls = st.builds(hull, generators, st.integers(4, 30))
