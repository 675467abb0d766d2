"""Polygons of the two photographs for a GIS: GeoPackage, shapefile, GeoJSON in longitude and latitude (extra `geo`)."""

import contextlib
import errno
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError, MissingDependency, OutputError
from zpm2.io import geojson
from zpm2.io.files import why
from zpm2.io.record import discard, put, scratch
from zpm2.model import Georeference, Polygon, PolygonArrays, PolygonMatch

Array = NDArray[np.float64]

DEGREES = 8  # decimals of longitude and latitude: about 1 mm
GEOPACKAGE = "1.2"  # version of the format: of newer ones a GIS of some years ago says that it may not read them well
LOG_FILES = ("-wal", "-shm", "-journal")  # of a GeoPackage that a GIS has open
SIDE_FILES = (".shp", ".shx", ".dbf", ".prj", ".cpg", ".qpj", ".qix", ".sbn", ".sbx")  # of a shapefile, others' too


@dataclass(frozen=True, eq=False)
class Layer:
    """The polygons of one photograph with what a GIS shows of them."""

    name: str  # "left" or "right"
    polygons: Sequence[Polygon]
    geo: Georeference  # of the photograph; without CRS or transform the layer lies in image px
    match_of: Mapping[int, tuple[int, float]]  # polygon id -> (partner's id, confidence 0..1)
    unmatched: Mapping[int, str]  # polygon id -> why it has no partner; may lack ids


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns of a layer: name -> (n,) values. Null is NaN, None, or where `nulls` (for integers) is true."""

    columns: dict[str, NDArray[Any]]
    nulls: dict[str, NDArray[np.bool_]]


def require_pyogrio() -> Any:
    """The package, or `MissingDependency`."""
    try:
        import pyogrio.raw
    except ImportError as error:
        raise MissingDependency('GeoPackage and shapefiles need pyogrio: pip install "zpm2[geo]"') from error
    return pyogrio


def has_pyogrio() -> bool:
    """Whether `require_pyogrio` finds it."""
    try:
        require_pyogrio()
    except MissingDependency:
        return False
    return True


def world_shapes(layer: Layer) -> NDArray[np.object_]:
    """(n,) shapely polygons in the CRS of the layer's photograph, in the order of a GIS (easting or longitude first).

    Where the photograph is not located they are in image px with y negated, which is where QGIS draws an image without
    georeference. Exteriors run counter-clockwise in these coordinates, holes clockwise.
    """
    vertices, ring_of, first_ring = _vertices(layer.polygons)
    vertices = layer.geo.to_world(vertices) if layer.geo.located else vertices * (1, -1)
    closed, offsets = _closed(vertices, ring_of, first_ring)
    polygon_type = shapely.GeometryType.POLYGON
    return np.asarray(shapely.from_ragged_array(polygon_type, closed, (offsets, first_ring)), object)


def write_geopackage(path: str | Path, left: Layer, right: Layer, matches: Sequence[PolygonMatch]) -> Path:
    """Writes both photographs' polygons and the matches as one GeoPackage, whole or not at all; returns the path.

    Two layers with the names and the coordinates (`world_shapes`) of `left` and `right`, each in the CRS of its own
    photograph or in the undefined Cartesian one, with the fields polygon_id, area_px, area_m2 (null where no ground
    sampling distance is known), score, parent, label, match (partner's polygon_id), confidence, unmatched; and a table
    "matches" without geometry: left, right (polygon_ids), confidence, cost, dsf, stage, overlap. `OutputError` where it
    cannot be written, and `path` is then what it was before.
    """
    path = Path(path)
    with _moved_into(path.parent, path) as folder:
        temporary = folder / "a.gpkg"
        for layer in (left, right):
            srs = {} if layer.geo.located else {"SRID": "-1"}
            _write(temporary, "GPKG", layer.name, _table(layer), world_shapes(layer), layer.geo, srs)
        _write(temporary, "GPKG", "matches", _match_table(matches))
        for suffix in LOG_FILES:  # of the file that was there: SQLite would apply them to the new one
            discard(path.with_name(path.name + suffix))
        put(temporary, path)
    return path


def write_shapefile(folder: str | Path, layer: Layer) -> Path:
    """Writes the layer as `<name>.shp` and its side files into an existing folder; returns the path of the .shp.

    Coordinates and fields are those of `write_geopackage`; text is UTF-8 and cut at 254 bytes, .prj is missing where
    the CRS is unknown. The files are moved in when all are complete, and those of an earlier shapefile of that name
    that are not replaced are removed. `OutputError` where it cannot be written.
    """
    target = Path(folder) / f"{layer.name}.shp"
    with _moved_into(target.parent, target) as temporary:
        _write(temporary / target.name, "ESRI Shapefile", layer.name, _table(layer), world_shapes(layer), layer.geo)
        for suffix in reversed(SIDE_FILES):  # .shp last
            part = temporary / f"{layer.name}{suffix}"
            if part.exists():
                put(part, target.with_suffix(suffix))
            else:
                discard(target.with_suffix(suffix))
    return target


def feature_collection(layer: Layer) -> dict[str, Any]:
    """The layer as a GeoJSON FeatureCollection of RFC 7946: WGS 84 longitude and latitude in degrees, 8 decimals.

    The photograph must be located (`geo.located`); for others there is `io.geojson`. "id" is the polygon's; properties
    are those of `io.geojson` ("area" in px^2), "area_m2" and "unmatched". Exteriors run counter-clockwise. A polygon
    across the antimeridian is not cut: its longitudes go on past 180 or -180, so that its outline does not jump.
    `InputError` where the CRS has no way to longitude and latitude, or a vertex lies where it is not defined.
    """
    assert layer.geo.located
    vertices, ring_of, first_ring = _vertices(layer.polygons)
    degrees = _degrees(layer, layer.geo.to_world(vertices))
    begins = np.searchsorted(ring_of, first_ring)  # of each polygon's vertices
    start = np.repeat(degrees[begins[:-1], 0], np.diff(begins))
    degrees[:, 0] -= 360 * np.round((degrees[:, 0] - start + 360 * np.round(start / 360)) / 360)
    closed, offsets = _closed(np.round(degrees, DEGREES), ring_of, first_ring)
    rings = [ring.tolist() for ring in np.split(closed, offsets[1:-1])]
    meters = _square_meters(layer.geo)
    features = []
    for k, polygon in enumerate(layer.polygons):
        properties = geojson.properties(polygon, *layer.match_of.get(polygon.id, (None, None))) | {
            "area_m2": None if meters is None else polygon.area * meters,
            "unmatched": layer.unmatched.get(polygon.id),
        }
        geometry = {"type": "Polygon", "coordinates": rings[first_ring[k] : first_ring[k + 1]]}
        features.append({"type": "Feature", "id": polygon.id, "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


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
    here = vertices - vertices[starts[ring_of]]  # small numbers, whose products keep their digits
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
    rasterio = _require_rasterio()
    try:
        lon_lat = rasterio.warp.transform(layer.geo.crs, "EPSG:4326", points[:, 0], points[:, 1])
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


def _square_meters(geo: Georeference) -> float | None:
    """m^2 of ground in one px^2, by the ground sampling distance or else by a projected CRS; None where unknown."""
    if geo.gsd is not None:
        return geo.gsd**2
    if geo.crs is None or geo.transform is None:
        return None
    crs = _require_rasterio().crs.CRS.from_user_input(geo.crs)
    if not crs.is_projected:
        return None
    return abs(float(np.linalg.det(geo.transform[:, :2]))) * float(crs.linear_units_factor[1]) ** 2


def _require_rasterio() -> Any:
    try:
        import rasterio.crs
        import rasterio.warp
    except ImportError as error:
        raise MissingDependency('reference systems need rasterio: pip install "zpm2[geo]"') from error
    return rasterio


def _table(layer: Layer) -> _Table:
    arrays = PolygonArrays(layer.polygons)
    polygons, ids = layer.polygons, [polygon.id for polygon in layer.polygons]
    partners = [layer.match_of.get(id) for id in ids]
    parent, no_parent = _integers([polygon.parent for polygon in polygons])
    match, no_match = _integers([partner and partner[0] for partner in partners])
    meters = _square_meters(layer.geo)
    columns = {
        "polygon_id": arrays.ids,
        "area_px": arrays.areas,
        "area_m2": arrays.areas * (np.nan if meters is None else meters),
        "score": np.array([polygon.score for polygon in polygons], np.float64),
        "parent": parent,
        "label": np.array([polygon.label for polygon in polygons], object),
        "match": match,
        "confidence": np.array([partner[1] if partner else np.nan for partner in partners], np.float64),
        "unmatched": np.array([layer.unmatched.get(id) for id in ids], object),
    }
    return _Table(columns, {"parent": no_parent, "match": no_match})


def _match_table(matches: Sequence[PolygonMatch]) -> _Table:
    kinds = {
        "left": np.int64,
        "right": np.int64,
        "confidence": np.float64,
        "cost": np.float64,
        "dsf": np.int64,
        "stage": object,
        "overlap": np.float64,
    }
    return _Table({name: np.array([getattr(m, name) for m in matches], kind) for name, kind in kinds.items()}, {})


def _integers(values: Sequence[int | None]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    null = np.array([value is None for value in values], bool)
    return np.array([value or 0 for value in values], np.int64), null


def _write(
    path: Path,
    driver: str,
    name: str,
    table: _Table,
    shapes: NDArray[np.object_] | None = None,
    geo: Georeference | None = None,
    options: Mapping[str, str] | None = None,
) -> None:
    """One layer into a new file, or added to it; a table without `shapes`. `OSError` where the disk is full."""
    pyogrio = require_pyogrio()
    body = None if shapes is None else shapely.to_wkb(shapes)
    with warnings.catch_warnings(), _full_disk_named(path.parent, body, len(next(iter(table.columns.values())))):
        warnings.filterwarnings("ignore", "'crs' was not provided")  # it is not known
        warnings.filterwarnings("ignore", ".*truncated", RuntimeWarning)  # long text in a shapefile
        pyogrio.raw.write(
            path,
            body,
            list(table.columns.values()),
            list(table.columns),
            [table.nulls.get(column) for column in table.columns],
            layer=name,
            driver=driver,
            geometry_type=None if shapes is None else "Polygon",
            crs=geo.crs if geo and geo.located else None,
            encoding="UTF-8",
            append=path.exists(),
            dataset_options={"VERSION": GEOPACKAGE} if driver == "GPKG" else {},
            layer_options=dict(options or {}),
        )


@contextlib.contextmanager
def _full_disk_named(folder: Path, body: NDArray[np.object_] | None, rows: int) -> Iterator[None]:
    """GDAL says of a full disk only that a transaction failed, and has given the space back by then: so is there room
    for about what was to be written?"""
    try:
        yield
    except RuntimeError as error:
        room = 2**20 + 300 * rows + 2 * sum(map(len, [] if body is None else body))
        if "No space left" in str(error) or shutil.disk_usage(folder).free < room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error
        raise


@contextlib.contextmanager
def _moved_into(parent: Path, target: Path) -> Iterator[Path]:
    """A folder in `parent` for files on their way to `target`; it goes away whatever happens.

    `OutputError` for what the system or GDAL have against the writing.
    """
    require_pyogrio()
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with scratch(parent) as folder:
            yield folder
    except OSError as error:
        raise OutputError(f"cannot write {target}: {why(error, target)}") from error
    except RuntimeError as error:  # all of pyogrio's
        raise OutputError(f"cannot write {target}: {' '.join(str(error).split())}") from error
