"""Random polygons and containers for the tests of the local matcher."""

import numpy as np

from zpm2.model import Polygon, PolygonArrays


def star(rng, n, center=(0.0, 0.0), size=10.0):
    """(n, 2) ring of a simple polygon around `center`, without symmetries."""
    angle = (np.arange(n) + rng.uniform(-0.35, 0.35, n)) * 2 * np.pi / n
    return np.array(center) + size * rng.uniform(0.5, 1.0, (n, 1)) * np.c_[np.cos(angle), np.sin(angle)]


def square(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def arrays(rings, holes=None):
    holes = holes or [()] * len(rings)
    return PolygonArrays([Polygon(100 + k, r, h) for k, (r, h) in enumerate(zip(rings, holes, strict=True))])
