"""GeoPackage and shapefile: layers of polygons with attributes (extra `geo`)."""

import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.errors import InputError
from zpm2.files.reading import regular
from zpm2.formats import geojson, gis
from zpm2.formats.properties import plain
from zpm2.formats.regions.ground import Parts, check_ground, oriented, outlines_of, to_ground, to_pixels
from zpm2.formats.regions.region import PREFIX, SEPARATOR, CarriedRegion, GivenRegion, GivenRegions, Photograph, ours
from zpm2.formats.table import GPKG, SHAPEFILE, Table

Column = NDArray[np.generic]

BYTES_PER_BYTE = 8  # of memory, for each of the file, while it is read
HEADS = {".gpkg": (rb"SQLite format 3\0.{52}(GPKG|GP1\d)", 72), ".shp": (rb"\0\0\x27\x0a", 4)}
DRIVERS = {".gpkg": GPKG, ".shp": SHAPEFILE}
UNPLACED = re.compile(r"(LOCAL_CS|ENGCRS|ENGINEERINGCRS)\[.*", re.DOTALL)  # reference systems of no place, in WKT


@dataclass(frozen=True, eq=False)
class Vectors:
    """One layer, as it was read."""

    path: Path
    layer: str
    crs: str | None  # None: px
    kind: str  # of its geometries, GDAL's name
    fids: NDArray[np.int64]  # (n,)
    shapes: NDArray[np.object_]  # (n,) shapely geometries without heights, None for those without any
    fields: list[str]
    columns: list[Column]  # (n,) each; numbers with nulls are floats with NaN
    types: list[str]  # numpy's names of the fields' types
    binary: list[str]  # fields that are left out, as their values are neither numbers nor text
    complete = True

    def read(self, photograph: Photograph) -> GivenRegions:
        """The regions in px, one for each feature."""
        notes, bodies = list[str](), self._bodies
        if self.crs is not None:
            check_ground(self.crs, photograph, self.path)
            bodies, more = to_pixels(bodies, self.crs, photograph)
            notes += more
        elif self._sign < 0:
            bodies = [tuple([ring * (1, -1) for ring in part] for part in parts) for parts in bodies]
            notes.append(f"{self.path.name} has no reference system and no y above 0: read as pixels with y upwards")
        if self.kind.endswith(("Z", "ZM")) or self.kind.startswith("2.5D"):
            notes.append(f"{self.path.name}: heights (z) are not used, and not written again")
        if self.binary:
            notes.append(f"{self.path.name}: {', '.join(self.binary)} (binary) not read, and not written again")
        values = [_values(column, kind) for column, kind in zip(self.columns, self.types, strict=True)]
        regions = []
        for row, body in enumerate(bodies):
            properties = {field: column[row] for field, column in zip(self.fields, values, strict=True)}
            id = self._own_id(row, properties)
            score = properties.pop("score", None)
            label = properties.pop("label", None)
            name = f"feature {row} of {self.path}"
            regions.append(
                GivenRegion(
                    body,
                    geojson.region_id(id),
                    geojson.id_text(id),
                    geojson.score(score, name),
                    None if label is None else str(label),
                    properties,
                    row,
                    self.crs,
                )
            )
        return GivenRegions(regions, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """The file and those that a GIS writes beside it."""
        if self._driver == GPKG:
            return tuple(f"{stem}.gpkg{suffix}" for suffix in ("", *gis.LOG_FILES))
        return tuple(stem + suffix for suffix in gis.SIDE_FILES)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same features with their columns and feature ids (in a shapefile their order), and ours as new columns;
        null geometries for those without an outline.

        On the ground in the photograph's reference system, if they were given on the ground; else in px.
        """
        shapes, crs, notes = outlines_of(carried), None, list[str]()
        if self.crs is not None:
            shapes, crs, notes = to_ground(carried, photograph)
        if crs is None and (self.crs is not None or self._sign < 0):  # as QGIS draws images without a georeference
            shapes = oriented(shapely.transform(shapes, lambda points: points * (1, -1)))
        multi = "Multi" in self.kind or any(s is not None and s.geom_type == "MultiPolygon" for s in shapes)
        gpkg = self._driver == GPKG
        options = {"FID": self._free_name("fid"), "GEOMETRY_NAME": self._free_name("geom")} if gpkg else {}
        table = self._table(carried, options.get("FID"))
        gis.write_file(path, self.layer, table, shapes, crs, "MultiPolygon" if multi else "Polygon", options)
        return notes

    @property
    def _driver(self) -> str:
        return DRIVERS[self.path.suffix.lower()]

    @cached_property
    def _bodies(self) -> list[Parts]:
        found = []
        for shape in self.shapes:
            parts = shapely.get_parts(shapely.get_parts(shape)) if shape is not None else []
            rings = [
                [geojson.ring(shapely.get_coordinates(ring), str(self.path)) for ring in (p.exterior, *p.interiors)]
                for p in parts
                if p.geom_type == "Polygon" and not p.is_empty
            ]
            found.append(tuple(rings))
        return found

    @cached_property
    def _sign(self) -> int:
        """-1 where y goes up in a layer in px: then nothing lies above 0."""
        top = shapely.bounds(self.shapes)[:, 3] if len(self.shapes) else np.zeros(0)
        known = top[np.isfinite(top)]
        return -1 if len(known) and known.max() <= 0 else 1

    def _own_id(self, row: int, properties: dict[str, object]) -> object:
        """In our own files the polygon's id, else the feature's in a GeoPackage, else a property that is one, else the
        row."""
        if isinstance(properties.get("polygon_id"), int) and "area_px" in properties:
            return properties["polygon_id"]
        if self._driver == GPKG:
            return int(self.fids[row])
        return geojson.own_id({}, properties, row)

    def _free_name(self, name: str) -> str:
        taken = {field.lower() for field in self.fields}
        while name in taken:
            name = f"_{name}"
        return name

    def _table(self, carried: Sequence[CarriedRegion], fid: str | None) -> Table:
        """The columns as they were, and ours."""
        rows = np.array([each.region.row for each in carried], np.int64)
        columns, nulls = dict[str, Column](), dict[str, NDArray[np.bool_]]()
        if fid is not None:
            columns[fid] = self.fids[rows]
        for field, column, kind in zip(self.fields, self.columns, self.types, strict=True):
            if field.lower().startswith(PREFIX):  # of an earlier run
                continue
            values = column[rows]
            if values.dtype.kind == "f" and np.dtype(kind).kind in "biu":  # there are nulls in it
                nulls[field] = np.isnan(values)
                values = np.nan_to_num(values).astype(kind)
            columns[field] = values
        added = [ours(each.attributes) for each in carried]
        return Table(columns, nulls).with_properties(added, self._driver)


def open_vectors(path: Path, layer: str | None = None) -> Vectors | None:
    """A layer of polygons, read at once: the one of that name, or else the only one. `InputError` for damaged files and
    for several layers; None for files that are none of these formats."""
    if not _is_of_driver(path):
        return None
    pyogrio = gis.require_pyogrio()
    file = os.path.abspath(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            chosen = _layer(pyogrio.list_layers(file), layer, path)
            info = pyogrio.read_info(file, layer=chosen)
            meta, fids, wkb, columns = pyogrio.raw.read(file, layer=chosen, force_2d=True, return_fids=True)
            shapes = shapely.from_wkb(wkb, on_invalid="ignore")
    except InputError:
        raise
    except Exception as error:  # GDAL's errors have no public base class
        text = " ".join(str(error).split())[:200]
        raise InputError(f"region file {path} is damaged or not complete ({text}): copy or write it again") from error
    crs = meta["crs"]
    if crs is not None and UNPLACED.match(crs):
        crs = None
    names = [str(field) for field in meta["fields"]]
    types = [str(kind) for kind in info["dtypes"]]
    held = [not any(isinstance(value, bytes) for value in column) for column in columns]
    fields, used, kinds = (list(compress(each, held)) for each in (names, columns, types))
    binary = [name for name in names if name not in fields]
    shapes, kind = np.asarray(shapes, object), str(info["geometry_type"])
    return Vectors(path, chosen, crs, kind, fids, shapes, fields, used, kinds, binary)


def _is_of_driver(path: Path) -> bool:
    """Whether it is what GDAL's driver of the suffix reads: other drivers might follow references to other files."""
    head, length = HEADS[path.suffix.lower()]
    try:
        with regular(path).open("rb") as file:
            start = file.read(length)
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    memory.refuse_above(path.stat().st_size * BYTES_PER_BYTE, f"region file {path}", "cut it to the photograph first")
    return re.match(head, start, re.DOTALL) is not None


def _layer(listed: NDArray[np.object_], wanted: str | None, path: Path) -> str:
    """The name of a layer of `pyogrio.list_layers`."""
    names = [str(name) for name, kind in listed if (kind is not None and "Polygon" in kind) or kind == "Unknown"]
    if wanted is not None:
        if wanted not in names:
            raise InputError(f"{path} has no layer '{wanted}' of polygons: it has {', '.join(names) or 'none'}")
        return wanted
    if len(names) != 1:
        how = f": give one as {path}{SEPARATOR}{names[0]}" if names else ": give another file"
        raise InputError(f"{path} has {len(names)} layers of polygons, {', '.join(names) or 'not one'}{how}")
    return names[0]


def _values(column: Column, kind: str) -> list[object]:
    """(n,) values of a column of a type as JSON values, dates as text."""
    if column.dtype.kind == "M":
        return [None if np.isnat(value) else str(value) for value in column]
    values = [plain(value) for value in column.tolist()]
    if column.dtype.kind == "f" and np.dtype(kind).kind in "biu":  # there are nulls in it
        whole = bool if kind == "bool" else int
        return [whole(value) if isinstance(value, float) else None for value in values]
    return values
