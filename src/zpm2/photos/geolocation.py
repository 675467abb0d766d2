"""From pixels of a raster to longitude and latitude and back: by reference system and transform, or by RPC."""

import math
import re
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError, MissingDependency
from zpm2.model import Georeference
from zpm2.model.messages import Note

if TYPE_CHECKING:
    from rasterio.crs import CRS
    from rasterio.io import DatasetReader
    from rasterio.rpc import RPC

Array = NDArray[np.float64]
WGS84 = "EPSG:4326"  # longitude and latitude, here always in this order
RPC_REACH = 2.0  # how far from their centre RPCs are used, in units of their own scale

_CRS = re.compile(r"(EPSG|ESRI|IGNF|OGC):\w+(\+\w+)?|\s*[A-Z][A-Z_0-9]*\s*[\[(].*", re.DOTALL)  # a code, or WKT
_SEMI_MAJOR, _ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3  # of WGS 84, m


class Geolocator(Protocol):
    """Image px to longitude and latitude in degrees, and back; (n, 2) each, NaN where this is not possible."""

    def to_lon_lat(self, points: Array) -> Array: ...
    def from_lon_lat(self, degrees: Array) -> Array: ...


class TransformGeolocator:
    """By a reference system (rasterio's CRS) and the affine map into it, for a photograph of `size` (width, height)
    px."""

    def __init__(self, crs: "CRS", geo: Georeference, size: tuple[int, int]) -> None:
        self._crs, self._geo, self._size = crs, geo, size

    def to_lon_lat(self, points: Array) -> Array:
        return _wrapped(_warped(self._crs, WGS84, self._geo.to_world(points)), 0.0)

    def from_lon_lat(self, degrees: Array) -> Array:
        return _to_image(self._crs, self._geo, self._size, _warped(WGS84, self._crs, degrees))


class RpcGeolocator:
    """By rational polynomial coefficients, on the surface of their mean height."""

    def __init__(self, rpcs: "RPC") -> None:
        self._rpcs = rpcs
        self._center = np.array([rpcs.long_off, rpcs.lat_off])
        self._reach = RPC_REACH * np.array([rpcs.long_scale, rpcs.lat_scale])

    def to_lon_lat(self, points: Array) -> Array:
        degrees = self._transformed(points, to_ground=True)
        return _wrapped(np.where(self._far(degrees), np.nan, degrees), 0.0)

    def from_lon_lat(self, degrees: Array) -> Array:
        degrees = _wrapped(degrees, float(self._center[0]))
        return self._transformed(np.where(self._far(degrees), np.nan, degrees), to_ground=False)

    def _far(self, degrees: Array) -> NDArray[np.bool_]:
        """(n, 1) whether a point is beyond the reach of the polynomials."""
        return np.asarray((np.abs(degrees - self._center) > self._reach).any(axis=1, keepdims=True))

    def _transformed(self, points: Array, to_ground: bool) -> Array:
        from rasterio.transform import RPCTransformer

        out = np.full(points.shape, np.nan)
        rows = np.flatnonzero(np.isfinite(points).all(axis=1))
        if len(rows):
            x, y = points[rows].T
            z = np.full(len(rows), float(self._rpcs.height_off))
            options = {"RPC_PIXEL_ERROR_THRESHOLD": 1e-4, "RPC_MAX_ITERATIONS": 50}
            with warnings.catch_warnings(), RPCTransformer(self._rpcs, **options) as transformer:
                warnings.simplefilter("ignore")  # on points without an image
                if to_ground:
                    out[rows] = np.column_stack(transformer.xy(y, x, z, offset="ul"))
                else:
                    out[rows] = np.column_stack(transformer.rowcol(x, y, z, op=np.positive)[::-1])
        return _finite(out)


def place_of(
    source: "DatasetReader", width: int, height: int, gsd: float | None, notes: list[str]
) -> tuple[Geolocator | None, Georeference]:
    """How to get from pixels to longitude and latitude (None: unknown), and the georeference for results."""
    affine = source.transform
    matrix = None if affine.is_identity else np.array(affine[:6], np.float64).reshape(2, 3)
    if matrix is not None and not (np.isfinite(matrix).all() and np.linalg.det(matrix[:, :2])):
        matrix = None
    geo, rpcs = Georeference(_crs_text(source.crs), matrix), _rpcs(source)
    place: Geolocator | None = None
    by_transform = TransformGeolocator(source.crs, geo, (width, height))
    if geo.located and _reaches_ground(by_transform, width, height):
        place = by_transform
    elif rpcs is not None and _reaches_ground(by_rpc := RpcGeolocator(rpcs), width, height):
        place = by_rpc
        notes.append(Note("Placed by its rational polynomial coefficients (RPC)."))
    elif matrix is None and source.gcps[0]:
        notes.append("Its ground control points are not used: warp it by them first to place it.")
    if gsd is None and place is not None:
        gsd = _pixel_size(place, width, height)
    return place, Georeference(geo.crs, geo.transform, gsd, None if rpcs is None else rpcs.to_dict())


def world_of(geo: Georeference) -> tuple[str, Callable[[Array], Array]] | None:
    """The reference system in which a GIS gets the polygons of a photograph, and the map from (n, 2) image px into it.

    The photograph's own, or WGS 84 where only RPCs place it (NaN beyond their reach); None where nothing places it.
    """
    if geo.crs is not None and geo.transform is not None:
        return geo.crs, geo.to_world
    if not geo.rpc:
        return None
    try:
        return WGS84, RpcGeolocator(_rpc_of(geo)).to_lon_lat
    except ImportError as error:
        raise MissingDependency('RPCs need rasterio: pip install "zpm2[geo]"') from error
    except (TypeError, ValueError):  # some are missing or not numbers
        return None


def from_world(
    geo: Georeference, size: tuple[int, int], crs: str, points: Array, part: NDArray[np.intp] | None = None
) -> Array:
    """(n, 2) coordinates of any reference system -> (n, 2) px of a photograph of `size` (width, height) px for which
    `world_of` knows a way, NaN beyond its reach.

    x or longitude comes first. By the photograph's own system, or else by its RPCs, at their mean height. `crs` is one
    that `check_crs` has passed. Points of one `part` (n,) stay together, by default each is one of its own.
    """
    if geo.crs is not None and geo.transform is not None:
        return _to_image(geo.crs, geo, size, between(crs, geo.crs, points), part)
    return RpcGeolocator(_rpc_of(geo)).from_lon_lat(between(crs, WGS84, points))


def check_crs(crs: str, what: str) -> None:
    """`InputError` where a text is no reference system that PROJ knows; `what` says whose it is."""
    try:
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
    except ImportError as error:
        raise MissingDependency('reference systems need rasterio: pip install "zpm2[geo]"') from error
    unknown = InputError(f"{what} is in an unknown reference system, {crs[:80]}: transform it to a known one")
    if not _CRS.fullmatch(crs):  # GDAL would also accept URLs and file names
        raise unknown
    try:
        CRS.from_user_input(crs)
    except CRSError as error:
        raise unknown from error


def wkt2(crs: str) -> str:
    """A reference system as WKT 2 (ISO 19162:2019)."""
    from rasterio.crs import CRS

    return str(CRS.from_user_input(crs).to_wkt(version="WKT2_2019"))


def between(source: str, target: str, points: Array) -> Array:
    """(n, 2) coordinates of one reference system -> (n, 2) of another, x or longitude first, NaN where it is not
    defined."""
    return points if source == target else _warped(source, target, points)


def meters_between(crs: str, starts: Array, ends: Array) -> Array:
    """(n, 2) m from each of n points to another, along the axes of a projected reference system; to the east and to the
    north on the ellipsoid (WGS 84) where coordinates are longitudes and latitudes. Short distances only."""
    from rasterio.crs import CRS

    system = CRS.from_user_input(crs)
    if system.is_projected:
        return (ends - starts) * float(system.linear_units_factor[1])
    starts, ends = between(crs, WGS84, starts), between(crs, WGS84, ends)
    lat = np.radians((starts[:, 1] + ends[:, 1]) / 2)
    turns = 1 - _ECCENTRICITY_2 * np.sin(lat) ** 2
    lon_lat = np.radians(np.column_stack([_wrapped(ends - starts, 0.0)[:, 0], ends[:, 1] - starts[:, 1]]))
    radii = [_SEMI_MAJOR / np.sqrt(turns) * np.cos(lat), _SEMI_MAJOR * (1 - _ECCENTRICITY_2) / turns**1.5]
    return lon_lat * np.column_stack(radii)


def _rpc_of(geo: Georeference) -> "RPC":
    from rasterio.rpc import RPC

    return RPC(**(geo.rpc or {}))


def _crs_text(crs: "CRS | None") -> str | None:
    if not crs:
        return None
    code = crs.to_epsg()
    return crs.to_wkt() if code is None else f"EPSG:{code}"


def _rpcs(source: "DatasetReader") -> "RPC | None":
    try:
        return source.rpcs or None
    except (KeyError, ValueError):  # some are missing or not numbers
        return None


def _reaches_ground(place: Geolocator, width: int, height: int) -> bool:
    spots = np.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)])
    return bool(np.isfinite(place.to_lon_lat(spots * (width, height))).any())


def _pixel_size(place: Geolocator, width: int, height: int) -> float | None:
    """m on the ground: the side of a square as large as a pixel in the middle of the image."""
    step = 5.0  # px: large against the rounding of longitudes, small against the curvature
    cross = step * np.array([(-1, 0), (1, 0), (0, -1), (0, 1)]) + np.array([width / 2, height / 2])
    lon, lat = np.radians(place.to_lon_lat(cross).T)
    normal = _SEMI_MAJOR / np.sqrt(1 - _ECCENTRICITY_2 * np.sin(lat) ** 2)
    east, north = np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon)
    spots = np.column_stack([normal * east, normal * north, normal * (1 - _ECCENTRICITY_2) * np.sin(lat)])
    area = float(np.linalg.norm(np.cross(spots[1] - spots[0], spots[3] - spots[2])))
    return math.sqrt(area) / (2 * step) if np.isfinite(area) and area > 0 else None


def _warped(source: "CRS | str", target: "CRS | str", points: Array) -> Array:
    """(n, 2) coordinates of one reference system -> (n, 2) of another, NaN where it is not defined."""
    from rasterio.warp import transform

    out = np.full(points.shape, np.nan)
    todo = [np.flatnonzero(np.isfinite(points).all(axis=1))]
    while todo:
        rows = todo.pop()
        if len(rows) == 0:
            continue
        try:
            out[rows] = np.column_stack(transform(source, target, points[rows, 0], points[rows, 1])[:2])
        except Exception:  # GDAL's errors have no public base class; one point outside makes all fail
            if len(rows) > 1:
                todo += np.array_split(rows, 2)
    return _finite(out)


def _to_image(
    crs: "CRS | str", geo: Georeference, size: tuple[int, int], points: Array, part: NDArray[np.intp] | None = None
) -> Array:
    """(n, 2) coordinates of a photograph's own reference system -> (n, 2) px. A part may be whole turns away: it is
    moved to the turn that is nearest to the photograph's middle, unless it overlaps the photograph where it is."""
    from rasterio.crs import CRS

    if len(points) and CRS.from_user_input(crs).is_geographic:
        corners = geo.to_world(np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * size)[:, 0]
        west, east = corners.min() - 1e-9, corners.max() + 1e-9  # a border may be rounded
        part = np.arange(len(points)) if part is None else part
        low, high = np.full(part.max() + 1, np.inf), np.full(part.max() + 1, -np.inf)
        np.fmin.at(low, part, points[:, 0])
        np.fmax.at(high, part, points[:, 0])
        with np.errstate(invalid="ignore"):  # of parts without any finite point
            turns = np.floor(((low + high) / 2 - (west + east) / 2 + 180) / 360)
        turns[(low <= east) & (high >= west)] = 0
        points = np.column_stack([points[:, 0] - 360 * turns[part], points[:, 1]])
    return geo.to_image(points)


def _finite(points: Array) -> Array:
    """The points, NaN where x or y is not finite."""
    return np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)


def _wrapped(degrees: Array, center: float) -> Array:
    """Longitudes moved by whole turns to within 180 degrees of `center`."""
    lon = degrees[:, 0]
    turns = np.where(np.abs(lon - center) > 180, np.floor((lon - center + 180) / 360), 0)
    return np.column_stack([lon - 360 * turns, degrees[:, 1]])
