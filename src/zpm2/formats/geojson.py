"""Polygons of one photograph as GeoJSON, in pixel coordinates and marked as such."""

import json
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
HIGHEST_SCORE = 1.1  # SAM predicts an IoU slightly above 1 at times
MAX_COORDINATE = 1e9  # px, no image has a pixel at a larger coordinate

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
    Raises `InputError` for anything but a FeatureCollection, for a reference system (coordinates must be px), and for
    wrong coordinates or scores.
    """
    if (
        not isinstance(data, dict)
        or data.get("type") != "FeatureCollection"
        or not isinstance(features := data.get("features"), list)
    ):
        raise InputError(f"{source} is not a GeoJSON FeatureCollection: write its polygons as one")
    _check_frame([data, *features], source)
    ours = data.get("coordinate_frame") == FRAME
    parsed = [_parse_feature(feature, f"feature {k} of {source}", ours) for k, feature in enumerate(features)]
    image = data.get("image")
    width, height, name = (
        image.get(member) if isinstance(image, dict) else None for member in ("width", "height", "name")
    )
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    return FeatureCollection(parsed, size, name if isinstance(name, str) else None)


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
    if isinstance(value, str) and value.isdecimal():
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


def _check_frame(holders: Sequence[object], source: str) -> None:
    """`InputError` where a collection, a feature or a geometry names a reference system (GeoJSON 2008)."""
    for holder in holders:
        geometry = holder.get("geometry") if isinstance(holder, dict) else None
        for member in (holder, geometry):
            crs = member.get("crs") if isinstance(member, dict) else None
            if crs is not None:
                named = crs.get("properties") if isinstance(crs, dict) else None
                name = named.get("name") if isinstance(named, dict) else None
                raise InputError(
                    f"{source} is in the reference system {name or json.dumps(crs)}, and regions are in pixels of the "
                    'photograph: transform its coordinates, or remove "crs" if they are pixels'
                )


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
    label, own_id, source_id = properties.get("label"), _own_id(feature, properties), properties.get("source_id")
    others = {key: value for key, value in properties.items() if key not in ("label", "score")}
    return Feature(
        name=name,
        parts=tuple([ring(values, name) for values in part] for part in parts),
        id=region_id(own_id),
        source_id=id_text(source_id if ours and source_id is not None else own_id),
        score=score(properties.get("score"), name),
        label=None if label is None else plain(str(label)),
        properties=plain(unprefixed(properties, OURS) if ours else others),
    )


def _own_id(feature: dict[str, object], properties: dict[str, object]) -> object:
    """The feature's id, or else the first property that is one."""
    if feature.get("id") is not None:
        return feature["id"]
    named = {key.lower(): value for key, value in reversed(properties.items()) if value is not None}
    return next((named[name] for name in ID_NAMES if name in named), None)
