"""GeoJSON: in pixels, in a named reference system (GeoJSON 2008), or in longitude and latitude (RFC 7946)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from zpm2.formats import geojson
from zpm2.formats.convert import Members
from zpm2.formats.layer import DEGREES
from zpm2.formats.properties import plain
from zpm2.formats.regions.ground import as_degrees, check_ground, outlines_of, to_ground, to_pixels
from zpm2.formats.regions.outlines import rings_of
from zpm2.formats.regions.region import (
    CarriedRegion,
    GivenRegion,
    GivenRegions,
    Photograph,
    check_size,
    name_of,
    other_photograph,
    ours,
    without_ours,
)
from zpm2.photos.geolocation import WGS84, world_of


@dataclass(frozen=True, eq=False)
class Features:
    """A FeatureCollection."""

    path: Path
    data: Members
    parsed: geojson.FeatureCollection
    complete = True

    def read(self, photograph: Photograph) -> GivenRegions:
        """The regions, one for each feature, in px."""
        if self.parsed.size:
            check_size(str(self.path), self.parsed.size, photograph)
        notes = other_photograph(self.parsed.image_name, photograph)
        bodies, crs = [feature.parts for feature in self.parsed.features], self.parsed.crs
        if crs is not None:
            check_ground(crs, photograph, self.path, self.parsed.crs_name)
        elif not self.parsed.in_pixels and as_degrees(bodies, photograph):
            crs = WGS84
            notes.append(f"{self.path.name} is read as longitude and latitude (RFC 7946): so it lies in the image")
        if crs is not None:
            bodies, more = to_pixels(bodies, crs, photograph)
            notes += more
        if self.parsed.heights:
            notes.append(f"{self.path.name}: heights (z) are not used, and not written again")
        named = zip(self.parsed.features, bodies, strict=True)
        regions = [
            GivenRegion(body, f.id, f.source_id, f.score, f.label, f.properties, row, crs)
            for row, (f, body) in enumerate(named)
        ]
        return GivenRegions(regions, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """One file of the same ending."""
        return (stem + self.path.suffix.lower(),)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same features, with a null geometry for those without an outline.

        What was given in px is in px of the photograph. All else is on the ground: in the photograph's reference system
        where the file named one, else in longitude and latitude.
        """
        given = next((each.region.crs for each in carried if each.region.crs is not None), None)
        world = world_of(photograph.geo)
        code = None if world is None else _code(world[0])
        shapes, crs, notes = outlines_of(carried), None, list[str]()
        if given is not None:
            shapes, crs, notes = to_ground(carried, photograph, degrees=self.parsed.crs is None or code is None)
        stale = {"bbox", "crs", "features", "image"} | (set() if crs is None else {"coordinate_frame"})
        members = {key: value for key, value in self.data.items() if key not in stale}
        if crs is None:
            image = {"name": name_of(photograph), "width": photograph.width, "height": photograph.height}
            members |= {"crs": None, "image": image}
        elif self.parsed.crs is not None and code is not None:
            members["crs"] = {"type": "name", "properties": {"name": code}}
        members["features"] = [
            self._feature(each, shape, crs == WGS84) for each, shape in zip(carried, shapes, strict=True)
        ]
        geojson.write(path, plain(members))
        return notes

    def _feature(self, each: CarriedRegion, shape: shapely.Geometry | None, degrees: bool) -> Members:
        given: Members = self.data["features"][each.region.row]
        properties = without_ours(given.get("properties") or {}) | ours(each.attributes)
        kept = {key: value for key, value in given.items() if key not in ("bbox", "crs")}
        geometry = None
        if shape is not None:
            multi = (given.get("geometry") or {}).get("type") == "MultiPolygon" or shape.geom_type == "MultiPolygon"
            if degrees:
                shape = shapely.transform(shape, lambda points: np.round(points, DEGREES))
            parts = [_rings(part) for part in shapely.get_parts(shape)]
            geometry = {"type": "MultiPolygon" if multi else "Polygon", "coordinates": parts if multi else parts[0]}
        return kept | {"properties": properties, "geometry": geometry}


def open_features(path: Path, data: Members) -> Features:
    """A parsed FeatureCollection. Errors are those of `geojson.parse`."""
    return Features(path, data, geojson.parse(data, str(path)))


def _rings(polygon: shapely.Polygon) -> list[list[list[float]]]:
    return [ring.tolist() for ring in rings_of(polygon)]


def _code(crs: str) -> str | None:
    """A reference system by the name that GeoJSON 2008 has for it; None where it has no code."""
    authority, _, code = crs.partition(":")
    if crs == WGS84:
        return "urn:ogc:def:crs:OGC:1.3:CRS84"
    return f"urn:ogc:def:crs:{authority}::{code}" if code.isdecimal() else None
