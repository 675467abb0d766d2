"""The polygons of one photograph on the ground, by its reference system or its RPCs (extra `geo`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError, MissingDependency
from zpm2.formats import geojson
from zpm2.formats.registry import PairResult
from zpm2.model import SIDES, Counterpart, Georeference, Polygon, counterparts
from zpm2.photos.geolocation import world_of

Array = NDArray[np.float64]

DEGREES = 8  # decimals of longitude and latitude: about 1 mm


@dataclass(frozen=True, eq=False)
class Layer:
    """The polygons of one photograph, and all that a GIS shows with them."""

    name: str  # "left" or "right"
    polygons: Sequence[Polygon]
    geo: Georeference  # of the photograph
    match_of: Mapping[int, Counterpart]  # by polygon id
    unmatched: Mapping[int, str]  # polygon id -> why it has no partner; may lack ids

    @property
    def crs(self) -> str | None:
        """The reference system that the layer lies in: the photograph's, or longitude and latitude where RPCs place it,
        at their mean height. None (image px) where nothing places the photograph, or RPCs do not cover all polygons."""
        return self._placed[0]

    @property
    def by_rpc(self) -> bool:
        """Whether RPCs place the layer, in longitude and latitude."""
        return self.crs is not None and not self.geo.located

    @cached_property
    def _placed(self) -> tuple[str | None, Array]:
        """`crs`, and (v, 2) the vertices of all rings there (`_vertices`)."""
        vertices, ring_of, first_ring = _vertices(self.polygons)
        world = world_of(self.geo)
        if world is None:
            return None, vertices
        crs, to_world = world
        if self.geo.located:
            return crs, to_world(vertices)
        degrees = _without_jumps(to_world(vertices), ring_of, first_ring)
        return (crs, degrees) if np.isfinite(degrees).all() else (None, vertices)


def layers_of(result: PairResult) -> tuple[Layer, Layer]:
    """The left and the right side of a result."""
    left, right = (
        Layer(name, side.polygons, side.geo, counterparts(result.matches, name), side.unmatched)
        for name, side in zip(SIDES, (result.left, result.right), strict=True)
    )
    return left, right


def world_shapes(layer: Layer) -> NDArray[np.object_]:
    """(n,) shapely polygons in the CRS of the layer, in the order of a GIS (easting or longitude first).

    Where nothing places the photograph (`Layer.crs` is None) they are in image px with y negated, as QGIS draws images
    without a georeference. Exteriors run counter-clockwise in these coordinates, holes clockwise.
    """
    _, ring_of, first_ring = _vertices(layer.polygons)
    vertices = layer._placed[1] * (1, -1 if layer.crs is None else 1)
    closed, offsets = _closed(vertices, ring_of, first_ring)
    polygon_type = shapely.GeometryType.POLYGON
    return np.asarray(shapely.from_ragged_array(polygon_type, closed, (offsets, first_ring)), object)


def feature_collection(layer: Layer) -> dict[str, object]:
    """The layer as a GeoJSON FeatureCollection of RFC 7946: WGS 84 longitude and latitude in degrees, 8 decimals.

    The layer must have a CRS (`Layer.crs`); for others there is `formats.geojson`. "id" is the polygon's; properties
    are those of `formats.geojson` ("area" in px^2) and "area_m2". Exteriors run counter-clockwise. A polygon
    across the antimeridian is not cut: its longitudes continue beyond 180 or -180, so that its outline has no jump.
    `InputError` where the CRS cannot be converted to longitude and latitude, or not at some vertex.
    """
    assert layer.crs is not None
    _, ring_of, first_ring = _vertices(layer.polygons)
    degrees = _without_jumps(_degrees(layer, layer._placed[1]), ring_of, first_ring)
    closed, offsets = _closed(np.round(degrees, DEGREES), ring_of, first_ring)
    rings = [ring.tolist() for ring in np.split(closed, offsets[1:-1])]
    meters = square_meters(layer.geo)
    features = []
    for k, polygon in enumerate(layer.polygons):
        ours = geojson.properties(polygon, layer.match_of.get(polygon.id), layer.unmatched.get(polygon.id))
        properties = ours | {"area_m2": None if meters is None else polygon.area * meters}
        geometry = {"type": "Polygon", "coordinates": rings[first_ring[k] : first_ring[k + 1]]}
        features.append({"type": "Feature", "id": polygon.id, "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def _without_jumps(degrees: Array, ring_of: NDArray[np.int64], first_ring: NDArray[np.int64]) -> Array:
    """(v, 2) longitudes and latitudes of `_vertices` with the longitudes of a polygon within half a turn of its
    first."""
    begins = np.searchsorted(ring_of, first_ring)  # of each polygon's vertices
    start = np.repeat(degrees[begins[:-1], 0], np.diff(begins))
    turns = np.round((degrees[:, 0] - start + 360 * np.round(start / 360)) / 360)
    return np.column_stack([degrees[:, 0] - 360 * turns, degrees[:, 1]])


def _vertices(polygons: Sequence[Polygon]) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """(v, 2) image px of all rings, exteriors before their holes; (v,) the ring of each; (n + 1,) polygons' first."""
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.holes)]
    ring_of = np.repeat(np.arange(len(rings)), np.array([len(ring) for ring in rings], np.int64))
    first_ring = np.cumsum([0, *(1 + len(polygon.holes) for polygon in polygons)])
    return np.concatenate([np.zeros((0, 2)), *rings]), ring_of, first_ring


def _closed(
    vertices: Array, ring_of: NDArray[np.int64], first_ring: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int64]]:
    """The rings of `_vertices`, first vertex repeated at the end, exteriors turned counter-clockwise and holes
    clockwise; and (r + 1,) the row at which each begins."""
    sizes = np.bincount(ring_of)
    starts = np.cumsum(sizes) - sizes
    here = vertices - vertices[starts[ring_of]]  # small numbers, so that products keep their digits
    after = np.arange(len(vertices)) + 1
    after[starts + sizes - 1] = starts
    cross = here[:, 0] * here[after, 1] - here[:, 1] * here[after, 0]
    clockwise = np.bincount(ring_of, cross, len(sizes)) < 0
    is_hole = np.ones(len(sizes), bool)
    is_hole[first_ring[:-1]] = False
    offsets = np.r_[0, np.cumsum(sizes + 1)]
    ring = np.repeat(np.arange(len(sizes)), sizes + 1)
    place = np.arange(len(ring)) - offsets[ring]
    turned = np.where(clockwise != is_hole, -1, 1)[ring]
    return vertices[starts[ring] + turned * place % sizes[ring]], offsets


def _degrees(layer: Layer, points: Array) -> Array:
    """(n, 2) coordinates of the layer's CRS -> (n, 2) longitude, latitude of WGS 84, degrees."""
    rasterio = require_rasterio()
    try:
        lon_lat = rasterio.warp.transform(layer.crs, "EPSG:4326", points[:, 0], points[:, 1])
        degrees = np.array(lon_lat, np.float64).T.reshape(-1, 2)
        finite = bool(np.isfinite(degrees).all())
    except Exception as error:  # GDAL's errors have no public base class
        raise _no_degrees(layer) from error
    if not finite:
        raise _no_degrees(layer)
    return degrees


def _no_degrees(layer: Layer) -> InputError:
    return InputError(
        f"the reference system of the {layer.name} image has no longitude and latitude for all of its polygons: "
        "write a GeoPackage instead"
    )


def square_meters(geo: Georeference) -> float | None:
    """m^2 of ground in one px^2, by the ground sampling distance or else by a projected CRS; None where unknown."""
    if geo.gsd is not None:
        return geo.gsd**2
    if geo.crs is None or geo.transform is None:
        return None
    crs = require_rasterio().crs.CRS.from_user_input(geo.crs)
    if not crs.is_projected:
        return None
    return abs(float(np.linalg.det(geo.transform[:, :2]))) * float(crs.linear_units_factor[1]) ** 2


def require_rasterio() -> ModuleType:
    """The package, or `MissingDependency`."""
    try:
        import rasterio.crs
        import rasterio.warp
    except ImportError as error:
        raise MissingDependency('reference systems need rasterio: pip install "zpm2[geo]"') from error
    return rasterio
