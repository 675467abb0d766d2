"""Shrinks polygons in the image, and samples their boundaries (paper 3.5.2, (1) and (3))."""

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray

from zpm2.config import CloudConfig
from zpm2.polygons.repair import largest

Array = NDArray[np.float64]


class PolygonScaler:
    """A polygon at scales s in (0, 1]; at 1 it is the polygon itself.

    The paper scales about the centroid. The result lies inside the polygon only if the whole boundary is visible from
    the centroid. For other polygons (concave, or with holes), the boundary is moved inwards instead, by (1 - s) times
    the radius of the largest inscribed circle. If that splits the polygon, the largest piece is used.
    """

    def __init__(self, polygon: shapely.Polygon) -> None:
        self.polygon = polygon
        self.radial = not polygon.interiors and _star_shaped(polygon)
        self.depth = 0.0 if self.radial else float(shapely.maximum_inscribed_circle(polygon).length)

    def at(self, scale: float) -> shapely.Polygon:
        """The polygon at a scale; empty if nothing is left."""
        if scale >= 1:
            return self.polygon
        if self.radial:
            return shapely.affinity.scale(self.polygon, scale, scale, origin=self.polygon.centroid)
        return largest(self.polygon.buffer(-(1 - scale) * self.depth, join_style="mitre"))


def densified(ring: Array, step: float) -> Array:
    """A closed ring (n, 2) with points added, so that neighbours are at most `step` apart: (k, 2).

    Neither ring repeats its first point at the end.
    """
    following = np.roll(ring, -1, axis=0)
    pieces = np.maximum(np.ceil(np.linalg.norm(following - ring, axis=1) / step).astype(np.int64), 1)
    edge = np.repeat(np.arange(len(ring)), pieces)
    first = np.cumsum(pieces) - pieces
    share = ((np.arange(len(edge)) - first[edge]) / pieces[edge])[:, None]
    return np.asarray(ring[edge] * (1 - share) + following[edge] * share)


def sample_spacing(shape: shapely.Polygon, config: CloudConfig) -> float:
    """Distance between samples of a polygon, px: `step`, or more for large ones, to keep to about `max_samples`."""
    return max(config.step, float(shape.area / config.max_samples) ** 0.5)


def rings_of(polygon: shapely.Polygon) -> list[Array]:
    """The exterior and the holes, (n, 2) each, without repeating the first vertex."""
    if polygon.is_empty:
        return []
    return [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _star_shaped(polygon: shapely.Polygon) -> bool:
    """Whether the whole boundary is visible from the centroid: every side turns around it in the same direction."""
    ring = rings_of(polygon)[0] - np.array(polygon.centroid.coords[0])
    following = np.roll(ring, -1, axis=0)
    turn = ring[:, 0] * following[:, 1] - ring[:, 1] * following[:, 0]
    return bool((turn > 0).all() or (turn < 0).all())
