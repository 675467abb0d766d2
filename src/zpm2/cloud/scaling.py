"""Polygons in the image made smaller, and sampled (paper 3.5.2, (1) and (3))."""

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray

from zpm2.config import CloudConfig
from zpm2.polygons.repair import largest

Array = NDArray[np.float64]


class PolygonScaler:
    """A polygon at scales s in (0, 1]; at 1 it is the polygon itself.

    The paper scales about the centroid. That stays inside only where the whole boundary is seen from the centroid. The
    boundary of other polygons (concave ones, and those with holes, which would grow into the ring) is moved inwards
    instead, by (1 - s) of the radius of the largest circle inside. Where that cuts a polygon into pieces, the largest
    one counts.
    """

    def __init__(self, polygon: shapely.Polygon) -> None:
        self.polygon = polygon
        self.radial = not polygon.interiors and _star_shaped(polygon)
        self.depth = 0.0 if self.radial else float(shapely.maximum_inscribed_circle(polygon).length)

    def at(self, scale: float) -> shapely.Polygon:
        """The polygon at a scale; empty where nothing is left."""
        if scale >= 1:
            return self.polygon
        if self.radial:
            return shapely.affinity.scale(self.polygon, scale, scale, origin=self.polygon.centroid)
        return largest(self.polygon.buffer(-(1 - scale) * self.depth, join_style="mitre"))


def densified(ring: Array, step: float) -> Array:
    """(k, 2) the vertices of a closed ring (n, 2), not repeated at the end, and points between them, at most `step`
    apart."""
    following = np.roll(ring, -1, axis=0)
    pieces = np.maximum(np.ceil(np.linalg.norm(following - ring, axis=1) / step).astype(np.int64), 1)
    edge = np.repeat(np.arange(len(ring)), pieces)
    first = np.cumsum(pieces) - pieces
    share = ((np.arange(len(edge)) - first[edge]) / pieces[edge])[:, None]
    return np.asarray(ring[edge] * (1 - share) + following[edge] * share)


def sample_spacing(shape: shapely.Polygon, config: CloudConfig) -> float:
    """px between samples of a polygon: `step`, and more for large ones, so that there are about `max_samples`."""
    return max(config.step, float(shape.area / config.max_samples) ** 0.5)


def rings_of(polygon: shapely.Polygon) -> list[Array]:
    """The exterior and the holes, (n, 2) each, the first vertex not repeated."""
    if polygon.is_empty:
        return []
    return [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _star_shaped(polygon: shapely.Polygon) -> bool:
    """Whether the centroid sees the whole boundary: every side turns around it the same way."""
    ring = rings_of(polygon)[0] - np.array(polygon.centroid.coords[0])
    following = np.roll(ring, -1, axis=0)
    turn = ring[:, 0] * following[:, 1] - ring[:, 1] * following[:, 0]
    return bool((turn > 0).all() or (turn < 0).all())
