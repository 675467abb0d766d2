"""Made-up polygons and results for the tests of the evaluation."""

import numpy as np

from zpm2.errors import Failed
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult


def box(index, x0, y0, x1, y1, holes=()):
    return Polygon(index, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float), tuple(holes))


def blobs(rng, n, size, first_id=0):
    """n star-shaped polygons that may overlap, reach out of the image and have a hole."""
    found = []
    for k in range(n):
        center, radius = rng.uniform([0, 0], size), np.exp(rng.uniform(np.log(4), np.log(min(size) / 3)))
        angles = np.linspace(0, 2 * np.pi, rng.integers(3, 20), endpoint=False)
        radii = radius * rng.uniform(0.6, 1.3, len(angles))
        spokes = np.c_[np.cos(angles), np.sin(angles)]
        holes = (center + spokes * radius * 0.3,) if rng.random() < 0.3 else ()
        found.append(Polygon(first_id + k, center + spokes * radii[:, None], holes))
    return found


def moved(polygon, offset, index):
    return Polygon(index, polygon.exterior + offset, tuple(hole + offset for hole in polygon.holes))


def match(left, right):
    return PolygonMatch(left, right, confidence=0.9, cost=1.0, dsf=5, stage="global")


def result(left, right, pairs, left_size, right_size=None):
    return MatchResult(
        left=ImagePolygons(*left_size, left),
        right=ImagePolygons(*(right_size or left_size), right),
        matches=[match(*pair) for pair in pairs],
        points=PointMatches.empty(),
        fundamental=Failed("made up"),
        homography=Failed("made up"),
        config={},
        timings={},
    )


def pixels(polygon, width, height):
    """(height, width) the pixels whose centre lies inside: a ray to the left crosses the outline an odd number of
    times. The plain reference of `label_raster.polygon_pixels`."""
    y, x = np.mgrid[:height, :width] + 0.5
    found = np.zeros((height, width), bool)
    for ring in (polygon.exterior, *polygon.holes):
        for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            if ay != by:
                crossed = (ay < y) != (by < y)
                found ^= crossed & (ax + (y - ay) * (bx - ax) / (by - ay) <= x)
    return found
