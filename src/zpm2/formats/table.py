"""The attributes of a layer as columns, for the files of a GIS."""

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.formats.layer import Layer, square_meters
from zpm2.formats.properties import PREFIX
from zpm2.model import PolygonArrays, PolygonMatch

GPKG, SHAPEFILE, PARQUET = "GPKG", "ESRI Shapefile", "Parquet"  # GDAL's names
# columns of a table beside ours, of 2000, 255 and as many as one likes
MOST_PROPERTIES = {GPKG: 1900, SHAPEFILE: 230, PARQUET: 10**6}
RESERVED = ("fid", "ogc_fid", "geom", "geometry")  # columns that the formats add themselves


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a layer: name -> (n,) values. Null is NaN, None, or where `nulls` (for integers) is true."""

    columns: dict[str, NDArray[np.generic]]
    nulls: dict[str, NDArray[np.bool_]]

    @staticmethod
    def of(rows: Sequence[Mapping[str, object]], driver: str) -> "Table":
        """A table with a column for each name in n rows of values."""
        return Table({}, {}).with_properties(rows, driver)

    def with_properties(self, rows: Sequence[Mapping[str, object]], driver: str) -> "Table":
        """The table with a column for each property that its n polygons were given with, as many as the format allows.

        A name that is taken (formats ignore case) gets a prefix. A shapefile cuts names to 10 bytes; names that become
        equal get a number. Columns of only booleans, integers or numbers keep their type. All others become text, with
        values that are not text as JSON.
        """
        columns, nulls = dict(self.columns), dict(self.nulls)
        taken = {*columns, "source_id", *RESERVED}
        for name in property_names(rows)[: MOST_PROPERTIES[driver]]:
            column = "".join(letter if letter.isprintable() else " " for letter in name)
            while column.lower() in taken or not column:
                column = PREFIX + column
            if driver == SHAPEFILE:
                shorts = (_cut(column, f"_{k}" if k else "") for k in itertools.count())
                column = next(short for short in shorts if short.lower() not in taken)
            taken.add(column.lower())
            columns[column], nulls[column] = _column([row.get(name) for row in rows])
        return Table(columns, nulls)


def property_names(rows: Iterable[Mapping[str, object]]) -> list[str]:
    """The names of given properties, in order of appearance."""
    return list(dict.fromkeys(name for row in rows for name in row))


def _cut(name: str, end: str) -> str:
    """A name with `end`, cut to 10 bytes."""
    return name.encode()[: 10 - len(end)].decode(errors="ignore") + end


def layer_table(layer: Layer, driver: str) -> Table:
    """The columns of a layer's polygons: polygon_id, area_px, area_m2 (null where no ground sampling distance is
    known), score, parent, label, match (partner's polygon_id), match_id, confidence, unmatched; of given regions
    source_id and their properties."""
    arrays = PolygonArrays(layer.polygons)
    polygons, ids = layer.polygons, [polygon.id for polygon in layer.polygons]
    partners = [layer.match_of.get(id) for id in ids]
    parent, no_parent = _integers([polygon.parent for polygon in polygons])
    match, no_match = _integers([None if partner is None else partner.polygon_id for partner in partners])
    match_id, _ = _integers([None if partner is None else partner.match_id for partner in partners])
    meters = square_meters(layer.geo)
    columns = {
        "polygon_id": arrays.ids,
        "area_px": arrays.areas,
        "area_m2": arrays.areas * (np.nan if meters is None else meters),
        "score": np.array([polygon.score for polygon in polygons], np.float64),
        "parent": parent,
        "label": np.array([polygon.label for polygon in polygons], object),
        "match": match,
        "match_id": match_id,
        "confidence": np.array([partner.confidence if partner else np.nan for partner in partners], np.float64),
        "unmatched": np.array([layer.unmatched.get(id) for id in ids], object),
    }
    nulls = {"parent": no_parent, "match": no_match, "match_id": no_match}
    if any(polygon.source_id is not None for polygon in polygons):
        columns["source_id"] = np.array([polygon.source_id for polygon in polygons], object)
    return Table(columns, nulls).with_properties([polygon.properties for polygon in polygons], driver)


def match_table(matches: Sequence[PolygonMatch]) -> Table:
    """match_id, left, right (polygon_ids), confidence, cost, dsf, stage, overlap."""
    kinds = {
        "match_id": np.int64,
        "left": np.int64,
        "right": np.int64,
        "confidence": np.float64,
        "cost": np.float64,
        "dsf": np.int64,
        "stage": object,
        "overlap": np.float64,
    }
    members = {"match_id": "id"}
    return Table(
        {name: np.array([getattr(m, members.get(name, name)) for m in matches], kind) for name, kind in kinds.items()},
        {},
    )


def _column(values: Sequence[object]) -> tuple[NDArray[np.generic], NDArray[np.bool_]]:
    """(n,) JSON values of any types as one type, and (n,) which of them are null."""
    null = np.array([value is None for value in values], bool)
    kinds = {type(value) for value in values if value is not None}
    if kinds == {bool}:
        return np.array([bool(value) for value in values], bool), null
    fit = all(abs(value) < 2**63 for value in values if isinstance(value, int))
    if kinds == {int} and fit:
        return _integers([value for value in values if isinstance(value, int | None)])
    if kinds in ({float}, {int, float}) and fit:
        numbers = [np.nan if value is None else value for value in values if isinstance(value, int | float | None)]
        return np.array(numbers, np.float64), null
    texts = [v if v is None or isinstance(v, str) else json.dumps(v, ensure_ascii=False) for v in values]
    return np.array(texts, object), null


def _integers(values: Sequence[int | None]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    null = np.array([value is None for value in values], bool)
    return np.array([value or 0 for value in values], np.int64), null
