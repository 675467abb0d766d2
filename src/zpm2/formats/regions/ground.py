"""Outlines of region files on the ground: from any reference system to the pixels of a photograph, and back."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.formats.geojson import Rings
from zpm2.formats.regions.region import CarriedRegion, Photograph, counted, name_of
from zpm2.photos.geolocation import WGS84, between, check_crs, from_world, world_of
from zpm2.polygons.shapes import as_objects

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]
Parts = tuple[Rings, ...]


def check_ground(crs: str, photograph: Photograph, path: Path, name: str | None = None) -> None:
    """`InputError` where a file in a reference system (by the `name` that the file has for it) cannot be brought to a
    photograph."""
    if world_of(photograph.geo) is None:
        raise InputError(
            f"{path} is in the reference system {(name or crs)[:80]}, and {name_of(photograph, 'the photograph')} has "
            'no georeference: transform its coordinates to pixels, or remove "crs" if they are pixels'
        )
    check_crs(crs, str(path))


def to_pixels(bodies: Sequence[Parts], crs: str, photograph: Photograph) -> tuple[list[Parts], list[str]]:
    """Rings in a reference system as rings in px, and a note on those that cannot be placed, which have no part.

    Edges stay straight between their vertices.
    """
    rings = [ring for parts in bodies for part in parts for ring in part]
    size, lengths = (photograph.width, photograph.height), [sum(map(len, part)) for parts in bodies for part in parts]
    of = np.repeat(np.arange(len(lengths)), lengths)
    points = from_world(photograph.geo, size, crs, np.concatenate([np.zeros((0, 2)), *rings]), of)
    placed = iter(np.split(points, np.cumsum([len(ring) for ring in rings])))
    found, lost = list[Parts](), 0
    for parts in bodies:
        body = tuple([next(placed) for _ in part] for part in parts)
        good = all(np.isfinite(ring).all() for part in body for ring in part)
        found.append(body if good else ())
        lost += not good
    return found, [f"{counted(lost, 'region')} beyond the reach of the georeference left out"] if lost else []


def as_degrees(bodies: Sequence[Parts], photograph: Photograph) -> bool:
    """Whether coordinates that name no reference system are longitudes and latitudes: all are degrees, and some lie in
    the georeferenced photograph."""
    if world_of(photograph.geo) is None:
        return False
    points = np.concatenate([np.zeros((0, 2)), *(ring for parts in bodies for part in parts for ring in part)])
    if not len(points) or not (np.abs(points) <= (360, 90)).all():
        return False
    x, y = from_world(photograph.geo, (photograph.width, photograph.height), WGS84, points).T
    return bool(((x >= 0) & (x <= photograph.width) & (y >= 0) & (y <= photograph.height)).any())


def to_ground(
    carried: Sequence[CarriedRegion], photograph: Photograph, degrees: bool = False
) -> tuple[Shapes, str | None, list[str]]:
    """The outlines of carried regions in the photograph's reference system, or in longitude and latitude: (n,) shapes,
    None without an outline; the system, None for px where the photograph has none; and notes.

    Exteriors run counter-clockwise.
    """
    shapes = outlines_of(carried)
    world = world_of(photograph.geo)
    if world is None:
        name = name_of(photograph, "the photograph")
        return shapes, None, [f"{name} has no georeference: its regions are in pixels"]
    crs, to_world = world
    target = WGS84 if degrees else crs
    found = oriented(shapely.transform(shapes, lambda points: between(crs, target, to_world(points))))
    lost = np.array([s is not None and not np.isfinite(shapely.get_coordinates(s)).all() for s in found], bool)
    found[lost] = None
    notes = [f"{counted(int(lost.sum()), 'region')} beyond the reach of the georeference: written without an outline"]
    return found, target, notes if lost.any() else []


def outlines_of(carried: Sequence[CarriedRegion]) -> Shapes:
    """(n,) the outlines of carried regions, `oriented`."""
    return oriented(as_objects([each.shape for each in carried]))


def oriented(shapes: Shapes) -> Shapes:
    """(n,) shapes with exteriors counter-clockwise and holes clockwise; empty ones as None."""
    out = np.full(len(shapes), None, object)
    for k, shape in enumerate(shapes):
        if shape is not None and not shape.is_empty:
            out[k] = turned(shape)
    return out


def turned(shape: shapely.Polygon | shapely.MultiPolygon) -> shapely.Polygon | shapely.MultiPolygon:
    """A shape with exteriors counter-clockwise and holes clockwise."""
    parts = [shapely.geometry.polygon.orient(part) for part in shapely.get_parts(shape)]
    return parts[0] if shape.geom_type == "Polygon" else shapely.MultiPolygon(parts)
