"""Polygons of one photograph as GeoJSON, in pixel coordinates and marked as such."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.writing import atomic_write
from zpm2.formats.properties import OURS, plain, polygon_properties, prefixed, unprefixed
from zpm2.model import Counterpart, Polygon

FRAME = "image px, origin at the outer corner of the top-left pixel, x right, y down, pixel centres at +0.5"
ID_NAMES = ("id", "fid", "objectid")  # properties in which programs write an id, in upper or lower case
LONGEST_ID = 4300  # digits, of a whole number that Python reads; a longer id stays text
HIGHEST_SCORE = 1.1  # SAM predicts an IoU slightly above 1 at times
MAX_COORDINATE = 1e9  # px, no image has a pixel at a larger coordinate

_CODE = re.compile(  # EPSG:25832, urn:ogc:def:crs:EPSG::25832, http://www.opengis.net/def/crs/EPSG/0/25832
    r"(?:urn:(?:x-)?ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?(EPSG|ESRI|IGNF)[:/](?:[\d.]*[:/])?(\w+)"
)
_LON_LAT = re.compile(r"(?:urn:(?:x-)?ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?OGC[:/](?:[\d.]*[:/])?CRS84h?")

Rings = list[NDArray[np.float64]]  # exterior first, then holes, each (n, 2) image px, not repeated at the end


@dataclass(frozen=True, eq=False)
class Feature:
    """One feature of a file; its polygons are not checked for validity."""

    name: str  # for messages
    parts: tuple[Rings, ...]  # one for a Polygon, several for a MultiPolygon, none for any other geometry
    id: int | None  # None where the file's id is not a whole number
    source_id: str | None  # the file's id as text
    score: float
    label: str | None
    properties: dict[str, object]  # all other properties


@dataclass(frozen=True, eq=False)
class FeatureCollection:
    """The features of a file, and the size and name of the photograph where the file states them."""

    features: list[Feature]
    size: tuple[int, int] | None  # (width, height) px
    image_name: str | None
    crs: str | None  # the reference system that the file names, as "EPSG:..." where it is known; None: none
    crs_name: str | None  # the same by the file's own name
    in_pixels: bool  # whether the file says that coordinates are px: by our frame or size, or by "crs": null
    heights: bool  # whether positions have a third number


def feature_collection(
    polygons: Sequence[Polygon],
    match_of: Mapping[int, Counterpart] | None,
    image_name: str,
    width: int,
    height: int,
    unmatched: Mapping[int, str] | None = None,
) -> dict[str, object]:
    """The polygons of an image of `width` x `height` px as a GeoJSON FeatureCollection in image px.

    By polygon id, `match_of` gives the match and `unmatched` the reason why there is none. GeoJSON only defines
    geographic coordinates. So the member "coordinate_frame" names the frame, and "crs": null (GeoJSON 2008: no
    reference system) tells programs not to take pixels for degrees. Exteriors have a positive shoelace sum, as RFC 7946
    asks for, although y points down here.
    """
    partners, reasons = match_of or {}, unmatched or {}
    return {
        "type": "FeatureCollection",
        "coordinate_frame": FRAME,
        "crs": None,
        "image": {"name": image_name, "width": width, "height": height},
        "features": [_feature(p, partners.get(p.id), reasons.get(p.id)) for p in polygons],
    }


def write(path: str | Path, collection: Mapping[str, object]) -> Path:
    """Writes a GeoJSON object, one feature a line. The file is complete or unchanged; coordinates keep every bit."""
    members = [
        f"{json.dumps(name)}: {_lines(value) if name == 'features' and isinstance(value, list) else _dump(value)}"
        for name, value in collection.items()
    ]
    return atomic_write(path, "{\n" + ",\n".join(members) + "\n}\n")


def parse(data: object, source: str) -> FeatureCollection:
    """The features of a parsed GeoJSON FeatureCollection; `source` names the file in messages.

    A feature's id stands beside its geometry or among its properties (`ID_NAMES`); "score" and "label" are properties.
    Coordinates stay in the reference system that the file names. Raises `InputError` for anything but a
    FeatureCollection, for several reference systems, and for wrong coordinates or scores.
    """
    if (
        not isinstance(data, dict)
        or data.get("type") != "FeatureCollection"
        or not isinstance(features := data.get("features"), list)
    ):
        raise InputError(f"{source} is not a GeoJSON FeatureCollection: write its polygons as one")
    crs, crs_name = _reference_system(data, features, source)
    ours = data.get("coordinate_frame") == FRAME
    parsed = [_parse_feature(feature, f"feature {k} of {source}", ours) for k, feature in enumerate(features)]
    image = data.get("image")
    width, height, name = (
        image.get(member) if isinstance(image, dict) else None for member in ("width", "height", "name")
    )
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    in_pixels = ours or size is not None or ("crs" in data and crs is None)
    heights = any(_has_heights(feature) for feature in features)
    return FeatureCollection(parsed, size, name if isinstance(name, str) else None, crs, crs_name, in_pixels, heights)


def ring(values: Sequence[Sequence[float]], name: str) -> NDArray[np.float64]:
    """(n, 2) float64 vertices of a list of positions (further numbers, as heights, are dropped), not repeated at the
    end. `InputError` where a position is not a pair of finite numbers; `name` says whose ring it is."""
    try:
        vertices = np.array([position[:2] for position in values], np.float64).reshape(len(values), 2)
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        raise InputError(f"{name} has coordinates that are not a list of [x, y] positions: correct the file") from error
    if not (np.abs(vertices) < MAX_COORDINATE).all():
        raise InputError(f"{name} has a coordinate that is not a finite number of pixels: correct the file")
    closed = len(vertices) > 1 and (vertices[0] == vertices[-1]).all()
    return vertices[:-1] if closed else vertices


def score(value: object, name: str) -> float:
    """A quality 0..1 from a file: 1 where it has none, at most 1. `InputError` beyond `HIGHEST_SCORE`."""
    if value is None:
        return 1.0
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= HIGHEST_SCORE:
        raise InputError(
            f"{name} has the score {value!r}: it must be a number from 0 to 1 (divide percentages by 100, or give what "
            "is no quality another name)"
        )
    return min(float(value), 1.0)


def region_id(value: object) -> int | None:
    """A whole number that is not negative, also where a program wrote it as text or as 12.0; else None."""
    if isinstance(value, str) and value.isdecimal() and len(value) <= LONGEST_ID:
        return int(value)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None


def id_text(value: object) -> str | None:
    """An id of any kind as text; None where there is none."""
    if value is None or value == "":
        return None
    number = region_id(value)
    return plain(value) if isinstance(value, str) else json.dumps(value if number is None else number)


def own_id(feature: Mapping[str, object], properties: Mapping[str, object], otherwise: object = None) -> object:
    """A feature's id, or else the first of its properties that is one (`ID_NAMES`)."""
    if feature.get("id") is not None:
        return feature["id"]
    named = {key.lower(): value for key, value in reversed(list(properties.items())) if value is not None}
    return next((named[name] for name in ID_NAMES if name in named), otherwise)


def properties(polygon: Polygon, partner: Counterpart | None, unmatched: str | None) -> dict[str, object]:
    """The properties of a polygon's feature: ours, and those of the file that the region came from."""
    return {**polygon_properties(polygon, partner, unmatched), **prefixed(polygon.properties, OURS)}


def _feature(polygon: Polygon, partner: Counterpart | None, unmatched: str | None) -> dict[str, object]:
    rings = [np.concatenate([r, r[:1]]).tolist() for r in (polygon.exterior, *polygon.holes)]
    return {
        "type": "Feature",
        "id": polygon.id,
        "properties": properties(polygon, partner, unmatched),
        "geometry": {"type": "Polygon", "coordinates": rings},
    }


def _dump(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _lines(features: list[object]) -> str:
    return "[\n" + ",\n".join(_dump(feature) for feature in features) + "\n]"


def _reference_system(
    data: dict[str, object], features: Sequence[object], source: str
) -> tuple[str | None, str | None]:
    """The one that a collection, or else each of its features or their geometries, names (GeoJSON 2008), and its name
    there."""
    found: dict[str | None, str | None] = {}
    for holder in features or [{}]:
        geometry = holder.get("geometry") if isinstance(holder, dict) else None
        members = [member.get("crs") for member in (geometry, holder, data) if isinstance(member, dict)]
        name = _crs_name(next((member for member in members if member is not None), None))
        found.setdefault(None if name is None else _crs_code(name), name)
    if len(found) > 1:
        names = " and ".join(str(name)[:80] if name else "none" for name in found)
        raise InputError(f"{source} mixes reference systems, {names}: bring all of its features into one")
    return next(iter(found.items()))


def _crs_name(crs: object) -> str | None:
    if crs is None or isinstance(crs, str):
        return crs
    properties = crs.get("properties") if isinstance(crs, dict) else None
    values = properties if isinstance(properties, dict) else {}
    if isinstance(crs, dict) and crs.get("type") == "EPSG":
        return f"EPSG:{values.get('code')}"
    name = values.get("name")
    return name if isinstance(name, str) else json.dumps(crs)


def _crs_code(name: str) -> str:
    """A reference system as PROJ names it, if GeoJSON has another name for it. Longitude comes first."""
    if _LON_LAT.fullmatch(name):
        return "EPSG:4326"
    code = _CODE.fullmatch(name)
    return f"{code[1]}:{code[2]}" if code else name


def _has_heights(feature: object) -> bool:
    """Whether the first position of a feature has a third number."""
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    position = geometry.get("coordinates") if isinstance(geometry, dict) else None
    while isinstance(position, list) and position and isinstance(position[0], list):
        position = position[0]
    return isinstance(position, list) and len(position) > 2


def _parse_feature(feature: object, name: str, ours: bool) -> Feature:
    """`ours`: the file was made by `feature_collection`."""
    if not isinstance(feature, dict):
        raise InputError(f"{name} is not a GeoJSON feature: correct the file")
    geometry, properties = feature.get("geometry") or {}, feature.get("properties") or {}
    if not isinstance(geometry, dict) or not isinstance(properties, dict):
        raise InputError(f"{name} has a geometry or properties that are not objects: correct the file")
    coordinates, kind = geometry.get("coordinates"), geometry.get("type")
    parts = [coordinates] if kind == "Polygon" else coordinates if kind == "MultiPolygon" else []
    if not isinstance(parts, list) or not all(isinstance(part, list) for part in parts):
        raise InputError(f"{name} has coordinates that are not those of a {kind}: correct the file")
    label, id, source_id = properties.get("label"), own_id(feature, properties), properties.get("source_id")
    others = {key: value for key, value in properties.items() if key not in ("label", "score")}
    return Feature(
        name=name,
        parts=tuple([ring(values, name) for values in part] for part in parts),
        id=region_id(id),
        source_id=id_text(source_id if ours and source_id is not None else id),
        score=score(properties.get("score"), name),
        label=None if label is None else plain(str(label)),
        properties=plain(unprefixed(properties, OURS) if ours else others),
    )
