"""Shift vectors: lines on the ground from a region in one photograph to the same one in another (extra `geo`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.formats import geojson, gis
from zpm2.formats.layer import DEGREES
from zpm2.formats.regions.region import GivenRegion, Photograph, name_of
from zpm2.formats.table import GPKG, Table
from zpm2.photos.geolocation import WGS84, between, meters_between, world_of

Array = NDArray[np.float64]

LAYER = "shifts"


@dataclass(frozen=True, eq=False)
class Shift:
    """Where a region is in two photographs."""

    region: GivenRegion
    left: Array  # (2,) px
    right: Array  # (2,) px
    sigma: float | None = None  # m, standard deviation of the shift along each axis; None: unknown


def has_shifts(left: Photograph, right: Photograph) -> bool:
    """Whether both photographs are placed on the ground, so that shifts can be measured."""
    return world_of(left.geo) is not None and world_of(right.geo) is not None


def write_shifts(path: Path, shifts: Sequence[Shift], left: Photograph, right: Photograph) -> Path:
    """Writes a layer of lines, one for each shift, as a GeoPackage or (other suffixes) as GeoJSON; returns the path.

    Lines lie in the right photograph's reference system, in GeoJSON in longitude and latitude. Columns: `id` (the
    region's, as text), `row`, `label`, `dx`, `dy` (m to the east and north, along the axes of a projected reference
    system), `length` (m) and `sigma` (m). Those that leave the reach of a georeference have no line. `InputError`
    where a photograph is not placed; `OutputError`.
    """
    for side in (left, right):
        if world_of(side.geo) is None:
            raise InputError(f"{name_of(side, 'the photograph')} has no georeference, so shifts have no size in metres")
    crs, starts, ends = _ends(shifts, left, right)
    meters = meters_between(crs, starts, ends)
    rows = [
        {
            "id": shift.region.source_id,
            "row": shift.region.row,
            "label": shift.region.label,
            "dx": _rounded(dx),
            "dy": _rounded(dy),
            "length": _rounded(float(np.hypot(dx, dy))),
            "sigma": None if shift.sigma is None else float(shift.sigma),
        }
        for shift, (dx, dy) in zip(shifts, meters.tolist(), strict=True)
    ]
    degrees = path.suffix.lower() != ".gpkg"
    lines = np.stack([starts, ends], axis=1)
    if degrees:
        flat = between(crs, WGS84, lines.reshape(-1, 2))
        lines = np.round(flat, DEGREES).reshape(-1, 2, 2)
    good = np.asarray(np.isfinite(lines).all(axis=(1, 2)))
    if degrees:
        features = [
            {
                "type": "Feature",
                "properties": row,
                "geometry": {"type": "LineString", "coordinates": line.tolist()} if known else None,
            }
            for row, line, known in zip(rows, lines, good, strict=True)
        ]
        return geojson.write(path, {"type": "FeatureCollection", "name": LAYER, "features": features})
    shapes = np.full(len(shifts), None, object)
    shapes[good] = shapely.linestrings(lines[good])
    return gis.write_file(path, LAYER, Table.of(rows, GPKG), shapes, crs, "LineString")


def _ends(shifts: Sequence[Shift], left: Photograph, right: Photograph) -> tuple[str, Array, Array]:
    """The right photograph's reference system, and (n, 2) both ends there."""
    of_left, of_right = world_of(left.geo), world_of(right.geo)
    assert of_left is not None
    assert of_right is not None
    starts = np.array([shift.left for shift in shifts], np.float64).reshape(-1, 2)
    ends = np.array([shift.right for shift in shifts], np.float64).reshape(-1, 2)
    return of_right[0], between(of_left[0], of_right[0], of_left[1](starts)), of_right[1](ends)


def _rounded(meters: float) -> float | None:
    return round(meters, 4) if np.isfinite(meters) else None
