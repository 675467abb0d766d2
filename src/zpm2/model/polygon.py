"""A polygon in image coordinates: the primitive that everything here matches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model.brief import brief


@dataclass(frozen=True, eq=False)
class Polygon:
    """One region of one image: a closed exterior ring and optional holes (paper 3.2, the graph G = (V, E)).

    Image coordinates: origin at the outer corner of the top-left pixel, x right, y down, pixel centres at +0.5, unit
    one pixel of the original image. V is `exterior`; E joins each vertex to the next and the last to the first.
    """

    id: int
    exterior: NDArray[np.float64]  # (n, 2) image px, n >= 3, positive shoelace sum, first vertex not repeated
    holes: tuple[NDArray[np.float64], ...] = ()  # (h, 2) image px each
    score: float = 1.0  # the segmenter's own quality, 0..1
    parent: int | None = None  # id of the smallest polygon of the same image that contains this one
    label: str | None = None  # a class name, where the source of the region gave one
    source_id: str | None = None  # of a given region: its id in the file that it came from, as text; parts share it
    properties: Mapping[str, object] = field(default_factory=dict)  # of a given region: what else its file says

    __repr__ = brief

    @cached_property
    def shape(self) -> shapely.Polygon:
        """The same region as a shapely polygon, in the same coordinates."""
        return shapely.Polygon(self.exterior, self.holes)

    @cached_property
    def area(self) -> float:
        """Area in px^2, holes taken out."""
        return float(self.shape.area)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) in image px."""
        low, high = self.exterior.min(0), self.exterior.max(0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def center(self) -> NDArray[np.float64]:
        """(2,) image px: the area centroid (c_i of the paper's Algorithm 1). It may lie outside a concave polygon."""
        c = self.shape.centroid
        return np.array([c.x, c.y])


def shapes_of(polygons: Sequence[Polygon]) -> NDArray[np.object_]:
    """(n,) `Polygon.shape` of each. Those that are not known yet are made together, which is faster."""
    new = [polygon for polygon in polygons if "shape" not in vars(polygon)]
    for polygon, shape in zip(new, shapes_of_rings([(p.exterior, *p.holes) for p in new]), strict=True):
        vars(polygon)["shape"] = shape
    shapes = np.empty(len(polygons), object)
    shapes[:] = [polygon.shape for polygon in polygons]
    return shapes


def shapes_of_rings(rings: Sequence[Sequence[NDArray[np.float64]]]) -> NDArray[np.object_]:
    """(n,) shapely polygons of their rings (m, 2), the exterior first."""
    every = [ring for own in rings for ring in own]
    if not every:
        return np.empty(0, object)
    of_vertex = np.repeat(np.arange(len(every)), [len(ring) for ring in every])
    of_ring = np.repeat(np.arange(len(rings)), [len(own) for own in rings])
    return np.asarray(shapely.polygons(shapely.linearrings(np.concatenate(every), indices=of_vertex), indices=of_ring))


@dataclass(frozen=True, eq=False)
class PolygonArrays:
    """Many polygons of one image as arrays, for the vectorised stages. Row k is `polygons[k]`, whatever its id."""

    polygons: Sequence[Polygon]
    ids: NDArray[np.int64] = field(init=False)  # (n,)
    shapes: NDArray[np.object_] = field(init=False)  # (n,) shapely polygons
    centers: NDArray[np.float64] = field(init=False)  # (n, 2) image px, area centroids
    areas: NDArray[np.float64] = field(init=False)  # (n,) px^2
    bounds: NDArray[np.float64] = field(init=False)  # (n, 4) x_min, y_min, x_max, y_max, image px

    __repr__ = brief

    def __post_init__(self) -> None:
        shapes = shapes_of(self.polygons)
        centroids = shapely.centroid(shapes)
        put = object.__setattr__
        put(self, "ids", np.array([p.id for p in self.polygons], np.int64))
        put(self, "shapes", shapes)
        put(self, "centers", np.c_[shapely.get_x(centroids), shapely.get_y(centroids)].reshape(-1, 2))
        put(self, "areas", shapely.area(shapes).astype(np.float64))
        put(self, "bounds", shapely.bounds(shapes).reshape(-1, 4))

    def __len__(self) -> int:
        return len(self.polygons)
