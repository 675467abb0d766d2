"""Polygons as GeoParquet (packages pyarrow and, for reference systems, rasterio; extras `parquet` and `geo`)."""

import json
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.files.writing import atomic_write
from zpm2.formats.layer import Layer, require_rasterio, world_shapes
from zpm2.formats.parquet import require_pyarrow
from zpm2.formats.table import PARQUET, Table, layer_table

VERSION = "1.1.0"  # of GeoParquet, https://geoparquet.org
GEOMETRY = "geometry"


def write_layer(path: Path, layer: Layer) -> Path:
    """Writes one photograph's polygons as GeoParquet: the columns of `table.layer_table` and `geometry` (WKB), in the
    CRS of the photograph as PROJJSON; without one in image px with y negated, and the CRS null. Returns the path."""
    shapes = world_shapes(layer)
    column: dict[str, object] = {
        "encoding": "WKB",
        "geometry_types": ["Polygon"] if len(shapes) else [],
        "orientation": "counterclockwise",
        "crs": None if layer.crs is None else _projjson(layer.crs),
    }
    if len(shapes):
        column["bbox"] = shapely.total_bounds(shapes).tolist()
    geo = {"version": VERSION, "primary_column": GEOMETRY, "columns": {GEOMETRY: column}}
    return write_table(path, layer_table(layer, PARQUET), shapely.to_wkb(shapes), {"geo": json.dumps(geo)})


def write_table(
    path: Path, table: Table, body: NDArray[np.object_] | None = None, metadata: dict[str, str] | None = None
) -> Path:
    """Writes columns, and `body` (bytes) as the column `geometry`, whole or not at all; returns the path."""
    pyarrow = require_pyarrow("GeoParquet")
    arrays = {}
    for name, values in table.columns.items():
        null = table.nulls.get(name)
        if null is None and values.dtype.kind == "f":
            null = np.isnan(values)
        kind = pyarrow.string() if values.dtype == object else None
        arrays[name] = pyarrow.array(values, kind, mask=null)
    if body is not None:
        arrays[GEOMETRY] = pyarrow.array(list(body), pyarrow.binary())
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(arrays).replace_schema_metadata(metadata), sink)
    return atomic_write(path, sink.getvalue().to_pybytes())


def _projjson(crs: str) -> object:
    return require_rasterio().crs.CRS.from_user_input(crs).to_dict(projjson=True)
