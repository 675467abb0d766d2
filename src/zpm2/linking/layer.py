"""A layer of polygons on the ground, in metres around a common centre (extra `geo`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.formats.regions.features import Features
from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import GivenRegion, RegionFile, Shape
from zpm2.formats.regions.registry import open_regions
from zpm2.formats.regions.vectors import Vectors
from zpm2.model import Georeference
from zpm2.model.messages import Note, about
from zpm2.photos.geolocation import WGS84, between, check_crs
from zpm2.polygons.shapes import as_objects

Array = NDArray[np.float64]

DEGREES = np.array([360.0, 90.0])  # the largest longitude and latitude


@dataclass(frozen=True, eq=False)
class Ground:
    """A reference system in the place of a photograph: its pixels are the system's coordinates.

    So readers and writers of region files need not know that there is no photograph.
    """

    path: str | None
    geo: Georeference
    width: int = 1
    height: int = 1

    @staticmethod
    def of(path: str | Path, crs: str) -> "Ground":
        """The ground of a file."""
        return Ground(str(path), Georeference(crs, np.eye(2, 3)))


@dataclass(frozen=True, eq=False)
class Layer:
    """The polygons of a file. Row k of everything is its region k."""

    file: RegionFile
    ground: Ground  # the file's own reference system
    regions: Sequence[GivenRegion]
    outlines: Sequence[Shape | None]  # in the file's own coordinates; None without an area
    notes: Sequence[str]  # for the user

    def name(self, row: int) -> str:
        """What a polygon is called: the file's id, else its row."""
        return self.regions[row].source_id or str(self.regions[row].row)


@dataclass(frozen=True, eq=False)
class Shapes:
    """The polygons of a layer that have an area, in metres."""

    rows: NDArray[np.int64]  # (n,) of the layer
    shapes: NDArray[np.object_]  # (n,) m
    centers: Array  # (n, 2) m, their centroids
    areas: Array  # (n,) m^2

    def __len__(self) -> int:
        return len(self.rows)

    @staticmethod
    def of(rows: NDArray[np.int64], shapes: NDArray[np.object_]) -> "Shapes":
        """With their centroids and areas."""
        centers = shapely.get_coordinates(shapely.centroid(shapes)).reshape(-1, 2)
        return Shapes(rows, shapes, centers, np.asarray(shapely.area(shapes), np.float64))

    def distinct(self) -> tuple["Shapes", NDArray[np.int64]]:
        """The largest polygon around each centre (to 1 mm), and (n,) which of them has the centre of each polygon."""
        order = np.argsort(-self.areas, kind="stable")
        _, first, same = np.unique(self.centers[order].round(3), axis=0, return_index=True, return_inverse=True)
        largest = np.zeros(len(self), np.int64)
        largest[order] = order[first][same.reshape(-1)]
        rows, which = np.unique(largest, return_inverse=True)
        return Shapes(self.rows[rows], self.shapes[rows], self.centers[rows], self.areas[rows]), which


def open_layer(path: str | Path) -> Layer:
    """The polygons of a GeoPackage, a shapefile or a GeoJSON.

    GeoJSON without "crs" is in longitude and latitude (RFC 7946). `InputError` for other files, for a file without a
    reference system, and for one without polygons.
    """
    file = open_regions(path)
    if not isinstance(file, Vectors | Features):
        raise InputError(f"{path} is no layer on the ground: give a GeoPackage, a shapefile or a GeoJSON")
    crs = file.crs if isinstance(file, Vectors) else _crs_of(file)
    if crs is None:
        raise InputError(f"{path} has no reference system, so nothing says where it lies: assign the one it is in")
    check_crs(crs, str(path))
    ground = Ground.of(path, crs)
    given = file.read(ground)
    outlines = [shape_of(region) for region in given.regions]
    empty = sum(outline is None for outline in outlines)
    if empty == len(outlines):
        raise InputError(f"{path} has no polygon with an area: give another file")
    notes = [Note(note) for note in given.notes]
    if empty:
        notes.append(Note(f"{empty} of {len(outlines)} regions have no area"))
    return Layer(file, ground, given.regions, outlines, about(Path(file.path).name, notes))


def local_frame(layer: Layer) -> str:
    """A reference system in metres around the middle of a layer, as PROJ has it: azimuthal equidistant."""
    crs, outlines = layer.ground.geo.crs, as_objects(layer.outlines)
    assert crs is not None
    x0, y0, x1, y1 = shapely.total_bounds(outlines)
    across = np.array([[x, (y0 + y1) / 2] for x in (x0, (x0 + x1) / 2, x1)])
    (west, _), (longitude, latitude), (east, _) = between(crs, WGS84, across)
    if east - west > 180:  # perhaps it lies on both sides of the antimeridian
        turned = between(crs, WGS84, shapely.get_coordinates(outlines))[:, 0] % 360
        if np.ptp(turned) < east - west:
            longitude = (turned.min() + turned.max()) / 2
    if not np.isfinite([longitude, latitude]).all():
        raise InputError(f"{layer.file.path} lies outside of its reference system: assign the one it is in")
    return f"+proj=aeqd +lat_0={latitude:.6f} +lon_0={longitude:.6f} +datum=WGS84 +units=m +no_defs"


def in_meters(layer: Layer, frame: str) -> Shapes:
    """The polygons of a layer in `frame` (`local_frame`). Those beyond its reach are left out."""
    crs = layer.ground.geo.crs
    assert crs is not None
    shapes = shapely.transform(as_objects(layer.outlines), lambda points: between(crs, frame, points))
    good = [k for k, s in enumerate(shapes) if s is not None and np.isfinite(shapely.get_coordinates(s)).all()]
    return Shapes.of(np.array(good, np.int64), np.asarray(shapes[good], object))


def _crs_of(file: Features) -> str | None:
    """The reference system of a GeoJSON; longitude and latitude where all coordinates are degrees."""
    if file.parsed.crs is not None or file.parsed.in_pixels:
        return file.parsed.crs
    rings = [ring for feature in file.parsed.features for part in feature.parts for ring in part]
    return WGS84 if all((np.abs(ring) <= DEGREES).all() for ring in rings) else None
