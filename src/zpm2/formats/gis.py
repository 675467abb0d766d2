"""Polygons of the two photographs as files for a GIS: GeoPackage and shapefile (extra `geo`)."""

import contextlib
import errno
import os
import shutil
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError, MissingDependency, OutputError
from zpm2.files.record import move_into_place, remove_own, temporary_folder
from zpm2.files.writing import why
from zpm2.formats.layer import Layer, feature_collection, world_shapes
from zpm2.formats.table import GPKG, MOST_PROPERTIES, SHAPEFILE, Table, layer_table, match_table, property_names
from zpm2.model import PolygonMatch
from zpm2.model.messages import Note

Array = NDArray[np.float64]

GEOPACKAGE = "1.2"  # version of the format; an older GIS warns of newer ones
NOW, EPOCH = "OGR_CURRENT_DATE", "1970-01-01"  # GDAL's option for the date in a GeoPackage
UTC = 100  # GDAL's number of the time zone in which GeoPackages have their times
LOG_FILES = ("-wal", "-shm", "-journal")  # of a GeoPackage that a GIS has open
SIDE_FILES = (".shp", ".shx", ".dbf", ".prj", ".cpg", ".qpj", ".qix", ".sbn", ".sbx")  # of a shapefile

_SETTING = threading.Lock()


def require_pyogrio() -> ModuleType:
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


def write_geopackage(path: str | Path, left: Layer, right: Layer, matches: Sequence[PolygonMatch]) -> Path:
    """Writes both photographs' polygons and the matches as one GeoPackage, whole or not at all; returns the path.

    Two layers with the names and the coordinates (`world_shapes`) of `left` and `right`, each in the CRS of its own
    photograph or in the undefined Cartesian one, with the fields polygon_id, area_px, area_m2 (null where no ground
    sampling distance is known), score, parent, label, match (partner's polygon_id), match_id, confidence, unmatched; of
    given regions source_id and their properties. And a table "matches" without geometry: match_id, left, right
    (polygon_ids), confidence, cost, dsf, stage, overlap. `OutputError` where it cannot be written; `path` then stays
    as it was.
    """
    path = Path(path)
    with moved_into(path.parent, path) as folder:
        temporary = folder / "a.gpkg"
        for layer in (left, right):
            srs = {"SRID": "-1"} if layer.crs is None else {}
            write_layer(temporary, GPKG, layer.name, layer_table(layer, GPKG), world_shapes(layer), layer.crs, srs)
        write_layer(temporary, GPKG, "matches", match_table(matches))
        for suffix in LOG_FILES:  # of the old file: SQLite would apply them to the new one
            remove_own(path.with_name(path.name + suffix))
        move_into_place(temporary, path)
    return path


def write_shapefile(folder: str | Path, layer: Layer) -> Path:
    """Writes the layer as `<name>.shp` and its side files into an existing folder; returns the path of the .shp.

    Coordinates and fields are those of `write_geopackage`; text is UTF-8 and cut at 254 bytes, .prj is missing where
    the CRS is unknown. The files are moved in when all are complete, and those of an earlier shapefile of that name
    that are not replaced are removed. `OutputError` where it cannot be written.
    """
    path = Path(folder) / f"{layer.name}.shp"
    return write_file(path, layer.name, layer_table(layer, SHAPEFILE), world_shapes(layer), layer.crs)


def write_file(
    path: Path,
    name: str,
    table: Table,
    shapes: NDArray[np.object_],
    crs: str | None,
    kind: str = "Polygon",
    options: Mapping[str, str] | None = None,
) -> Path:
    """Writes one layer of geometries of a `kind` (GDAL's name) as a GeoPackage or shapefile, by the path's suffix, in
    place of an earlier one; returns the path. `OutputError`; `path` then stays as it was."""
    driver = SHAPEFILE if path.suffix.lower() == ".shp" else GPKG
    with moved_into(path.parent, path) as folder:
        part = folder / f"a{path.suffix}"
        if driver == SHAPEFILE:
            undated = {"DBF_DATE_LAST_UPDATE": EPOCH}
            write_layer(part, driver, name, table, shapes, crs, undated, kind)
            made = {part.with_suffix(suffix): path.with_suffix(suffix) for suffix in reversed(SIDE_FILES)}  # .shp last
        else:
            unplaced = {"SRID": "-1"} if crs is None else {}
            write_layer(part, driver, name, table, shapes, crs, {**unplaced, **(options or {})}, kind)
            # logs of the old file: SQLite would apply them to the new one
            made = {Path(f"{part}{suffix}"): Path(f"{path}{suffix}") for suffix in (*LOG_FILES, "")}
        for each, target in made.items():
            if each.exists():
                move_into_place(each, target)
            else:
                remove_own(target)
    return path


def messages(layers: Sequence[Layer]) -> list[str]:
    """Warnings of what files for a GIS will lack, and notes on how they are made."""
    found: list[str] = []
    for layer in layers:
        geo, image = layer.geo, f"{layer.name} image"
        if layer.by_rpc and geo.rpc is not None:
            height = f"{geo.rpc['height_off']:g} m"
            found.append(
                Note(
                    f"{image}: files for a GIS are in longitude and latitude at the mean height of its RPC, {height}: "
                    "what lies higher or lower is shifted there"
                )
            )
        elif geo.rpc and layer.crs is None:
            found.append(f"{image}: its RPC does not cover all of its polygons: files for a GIS are in image px")
        if geo.crs is None and geo.transform is not None:
            found.append(
                f"{image}: its geotransform has no reference system, results are in image px: assign the one it is in"
            )
        try:
            _ = layer.crs is None or feature_collection(layer)
        except InputError:
            found.append(
                f"{image}: its reference system has no longitude and latitude: {layer.name}.geojson is in image px"
            )
        given = len(property_names(polygon.properties for polygon in layer.polygons))
        if given > min(MOST_PROPERTIES.values()):
            found.append(
                f"{layer.name} regions: of their {given} properties a shapefile has the first "
                f"{MOST_PROPERTIES[SHAPEFILE]} and a GeoPackage the first {MOST_PROPERTIES[GPKG]}; GeoJSON has all"
            )
    if any(layer.crs is not None for layer in layers) and not has_pyogrio():
        found.append('matches.gpkg needs pyogrio and is not written: pip install "zpm2[geo]"')
    return found


def write_layer(
    path: Path,
    driver: str,
    name: str,
    table: Table,
    shapes: NDArray[np.object_] | None = None,
    crs: str | None = None,
    options: Mapping[str, str] | None = None,
    kind: str = "Polygon",
) -> None:
    """One layer of geometries of a `kind` (GDAL's name) into a new file, or added to it; a table without `shapes`.

    `OSError` where the disk is full.
    """
    pyogrio = require_pyogrio()
    body = None if shapes is None else shapely.to_wkb(shapes)
    rows = len(next(iter(table.columns.values()), []))
    times = [name for name, values in table.columns.items() if values.dtype.kind == "M" and driver == GPKG]
    with warnings.catch_warnings(), _undated(pyogrio), _full_disk_named(path.parent, body, rows):
        warnings.filterwarnings("ignore", "'crs' was not provided")  # it is not known
        warnings.filterwarnings("ignore", ".*truncated", RuntimeWarning)  # long text in a shapefile
        warnings.filterwarnings("ignore", ".*laundered", RuntimeWarning)  # names over 10 letters there
        pyogrio.raw.write(
            path,
            body,
            list(table.columns.values()),
            list(table.columns),
            [table.nulls.get(column) for column in table.columns],
            layer=name,
            driver=driver,
            geometry_type=None if shapes is None else kind,
            promote_to_multi=kind.startswith("Multi"),
            crs=crs,
            encoding="UTF-8",
            append=path.exists(),
            gdal_tz_offsets={name: np.full(rows, UTC, np.int64) for name in times},
            dataset_options={"VERSION": GEOPACKAGE} if driver == GPKG else {},
            layer_options=dict(options or {}),
        )


@contextlib.contextmanager
def _undated(pyogrio: ModuleType) -> Iterator[None]:
    """Makes GDAL write `EPOCH` as the date, so that the same polygons give the same bytes, unless the user has
    set another time. The setting holds for the whole process, so only one thread at a time may change it."""
    with _SETTING:
        before = pyogrio.get_gdal_config_option(NOW)
        pyogrio.set_gdal_config_options({NOW: before or f"{EPOCH}T00:00:00.000Z"})
        try:
            yield
        finally:
            pyogrio.set_gdal_config_options({NOW: before})


@contextlib.contextmanager
def _full_disk_named(folder: Path, body: NDArray[np.object_] | None, rows: int) -> Iterator[None]:
    """Reports a full disk as the reason for a failed write.

    GDAL only reports that a transaction failed, and has freed the space by then. So we check whether the disk has room
    for about the size of the file.
    """
    try:
        yield
    except RuntimeError as error:
        room = 2**20 + 300 * rows + 2 * sum(len(each) for each in (() if body is None else body) if each is not None)
        if "No space left" in str(error) or shutil.disk_usage(folder).free < room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error
        raise


@contextlib.contextmanager
def moved_into(parent: Path, target: Path) -> Iterator[Path]:
    """A temporary folder in `parent` for files that will become `target`; always removed at the end.

    `OutputError` where the system or GDAL cannot write.
    """
    require_pyogrio()
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with temporary_folder(parent) as folder:
            yield folder
    except OSError as error:
        raise OutputError(f"cannot write {target}: {why(error, target)}") from error
    except RuntimeError as error:  # all of pyogrio's
        raise OutputError(f"cannot write {target}: {' '.join(str(error).split())}") from error
