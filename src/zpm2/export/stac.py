"""A result as an Item of a SpatioTemporal Asset Catalog (STAC 1.1, projection extension 2.0): where and when its
photographs were taken, and its files."""

import json
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from zpm2.errors import ConfigError, InputError
from zpm2.files.listing import distinct_stems
from zpm2.files.reading import WRONG
from zpm2.files.writing import atomic_write
from zpm2.model import SIDES, ImagePolygons
from zpm2.photos import pictures
from zpm2.photos.geolocation import WGS84, between, from_world, wkt2, world_of
from zpm2.result import MatchResult

VERSION, PROJECTION = "1.1.0", "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
EDGE = 20  # points along each side of a photograph, whose outline is curved in longitude and latitude
DIGITS = 7  # of degrees: 1 cm
ORIGINAL, OFFSET, TIFF_TIME = 0x9003, 0x9011, 0x0132  # tags
GEOTIFF = "image/tiff; application=geotiff"
PHOTOGRAPHS = {".tif": "image/tiff", ".tiff": "image/tiff", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
PHOTOGRAPHS |= {".png": "image/png", ".jp2": "image/jp2", ".webp": "image/webp", ".bmp": "image/bmp"}
FILES = {  # name: media type, role
    "matches.json": ("application/json", "data"),
    "matches.gpkg": ("application/geopackage+sqlite3", "data"),
    "left.geojson": ("application/geo+json", "data"),
    "right.geojson": ("application/geo+json", "data"),
    "matches.parquet": ("application/vnd.apache.parquet", "data"),
    "left.parquet": ("application/vnd.apache.parquet", "data"),
    "right.parquet": ("application/vnd.apache.parquet", "data"),
    "left.coco.json": ("application/json", "data"),
    "right.coco.json": ("application/json", "data"),
    "left.labelme.json": ("application/json", "data"),
    "right.labelme.json": ("application/json", "data"),
    "left.cvat.xml": ("application/xml", "data"),
    "right.cvat.xml": ("application/xml", "data"),
    "left.yolo.txt": ("text/plain", "data"),
    "right.yolo.txt": ("text/plain", "data"),
    "left.shp": ("application/vnd.shp", "data"),
    "right.shp": ("application/vnd.shp", "data"),
    "overlay.png": ("image/png", "overview"),
    "unmatched.png": ("image/png", "overview"),
    "contact.png": ("image/png", "overview"),
    "report.html": ("text/html", "overview"),
}
Times = tuple[datetime, datetime]  # the first and the last moment, with their zones
Json = Mapping[str, object]


def names(folders: Sequence[Path]) -> list[str]:
    """The file of each result's Item: that of its folder, which is the Item's id, with .json."""
    return [f"{stem}.json" for stem in distinct_stems([Path(os.path.abspath(folder)) for folder in folders])]


def write(results: Sequence[tuple[Path, MatchResult]], out: Path, times: Times | None) -> list[str]:
    """Writes an Item of each result (its folder, and what was read from it) into a folder. Returns what was missing.

    times: when the photographs were taken; None: as they say themselves. `InputError` where a result is not
    georeferenced, or a photograph does not say when it was taken.
    """
    messages: list[str] = []
    items = []
    for name, (folder, result) in zip(names([folder for folder, _ in results]), results, strict=True):
        made, missing = item(name.removesuffix(".json"), folder, result, out, times)
        items.append((name, json.dumps(made, indent=2, allow_nan=False) + "\n"))
        messages += missing
    for name, text in items:
        atomic_write(out / name, text)
    return messages


def item(id: str, folder: Path, result: MatchResult, home: Path, times: Times | None) -> tuple[Json, list[str]]:
    """The Item of a result, for a file in the folder `home`, from which it names all files, and what was missing."""
    sides = result.left, result.right
    ground = footprint(sides)
    when = times or _taken([side.path for side in sides])
    first, last = map(_text, when)
    codes = {side.geo.crs if side.geo.located else None for side in sides}
    code = codes.pop() if len(codes) == 1 else None
    properties: dict[str, object] = {
        "title": " and ".join(Path(side.path).name for side in sides if side.path is not None),
        "description": f"{len(result.matches)} matched polygons of two photographs",
        "datetime": first if first == last else None,
        **({} if first == last else {"start_datetime": first, "end_datetime": last}),
        "proj:code": code if code is not None and code.startswith("EPSG:") else None,
    }
    assets: dict[str, Json] = {}
    missing = []
    for name, side in zip(SIDES, sides, strict=True):
        if side.path is None or not os.path.isfile(side.path):
            missing.append(f"{side.path} is no longer there, and no asset of {id}")
            continue
        kind = PHOTOGRAPHS.get(Path(side.path).suffix.lower(), "application/octet-stream")
        kind = GEOTIFF if kind == "image/tiff" and side.geo.located else kind
        gsd = {} if side.geo.gsd is None else {"gsd": round(side.geo.gsd, 6)}
        found = {"href": _href(Path(side.path), home), "type": kind, "roles": ["source"], **gsd, **_projection(side)}
        assets[name] = {**found, "title": f"{name} photograph"}
    for file, (kind, role) in FILES.items():
        if (folder / file).is_file():
            assets[file] = {"href": _href(folder / file, home), "type": kind, "roles": [role]}
    return {
        "type": "Feature",
        "stac_version": VERSION,
        "stac_extensions": [PROJECTION],
        "id": id,
        "bbox": bounds(ground),
        "geometry": shapely.geometry.mapping(cut(ground)),
        "properties": properties,
        "links": [],
        "assets": assets,
    }, missing


def read_times(text: str) -> Times:
    """A moment, or START/END, by ISO 8601; without a zone in UTC. `ConfigError` for another text."""
    try:
        parts = [datetime.fromisoformat(part.strip()) for part in text.split("/")]
        zoned = [(part if part.tzinfo is not None else part.replace(tzinfo=UTC)).astimezone(UTC) for part in parts]
    except (ValueError, OverflowError):  # in UTC beyond the calendar
        zoned = []
    if len(zoned) not in (1, 2) or zoned[0] > zoned[-1]:
        raise ConfigError(f"--datetime {text}: give a moment as 2024-05-31T10:30:00Z, or two of them as START/END")
    return zoned[0], zoned[-1]


def taken(photograph: Path) -> datetime | None:
    """When a photograph was taken, by EXIF, else by the TIFF tag DateTime; in UTC where the file says no zone, as most
    do. None where it says nothing."""
    try:
        with pictures.looked_at(photograph) as picture:
            tags = pictures.exif_of(picture)
            own = tags.get_ifd(pictures.EXIF_IFD)
            text, zone = (own[ORIGINAL], own.get(OFFSET)) if ORIGINAL in own else (tags[TIFF_TIME], None)
        found = datetime.strptime(str(text).strip("\0 ")[:19], "%Y:%m:%d %H:%M:%S")
        zoned = datetime.fromisoformat(f"{found.isoformat()}{str(zone).strip() if zone else '+00:00'}")
        return zoned.astimezone(UTC)
    except (*pictures.DAMAGE, *WRONG):  # none, or not as they should be
        return None


def footprint(sides: Sequence[ImagePolygons]) -> BaseGeometry:
    """What the photographs show, in degrees of longitude and latitude on WGS 84. Longitudes go on beyond 180 where it
    crosses the antimeridian, and end at 180 where it goes all the way round. `InputError` where a photograph has no
    place."""
    found, middle = [], None
    for side in sides:
        known = world_of(side.geo)
        if known is None:
            raise InputError(
                f"{side.path} is not georeferenced: a STAC Item needs photographs with a reference system or RPCs"
            )
        crs, to_world = known
        t = np.arange(EDGE) / EDGE
        x, y = np.r_[t, np.ones(EDGE), 1 - t, np.zeros(EDGE)], np.r_[np.zeros(EDGE), t, np.ones(EDGE), 1 - t]
        ring: NDArray[np.float64] = between(crs, WGS84, to_world(np.c_[x * side.width, y * side.height]))
        if not np.isfinite(ring).all():
            raise InputError(f"the border of {side.path} has no longitude and latitude everywhere: correct its place")
        middle = ring[0, 0] if middle is None else middle
        ring = np.concatenate([ring, ring[:1]])
        ring[:, 0] = np.unwrap(middle + (ring[:, 0] - middle + 180) % 360 - 180, period=360)
        if abs(ring[-1, 0] - ring[0, 0]) > 180:
            pole = _pole(side)
            ring = np.concatenate([ring, [(ring[-1, 0], pole), (ring[0, 0], pole)]])
        shape = shapely.Polygon(np.round(ring, DIGITS)).buffer(0)
        if not _parts(shape):
            raise InputError(f"the border of {side.path} encloses no area on the Earth: correct its place")
        found.append(shape)
    ground = shapely.union_all(found, grid_size=10.0**-DIGITS)
    west, _, east, _ = ground.bounds
    whole_turn = round(east - west, DIGITS) >= 360
    return shapely.union_all(_parts(ground), grid_size=10.0**-DIGITS) if whole_turn else ground


def bounds(ground: BaseGeometry) -> list[float]:
    """West, south, east, north; west is more than east across the antimeridian (RFC 7946)."""
    x0, y0, x1, y1 = ground.bounds
    return [round(float(value), DIGITS) for value in (_within(x0), y0, _within(x1), y1)]


def cut(ground: BaseGeometry) -> BaseGeometry:
    """The footprint within 180 degrees of longitude, cut at the antimeridian, outer rings counter-clockwise."""
    found = [orient(part) for part in _parts(ground)]
    whole = found[0] if len(found) == 1 else shapely.MultiPolygon(found)
    return shapely.transform(whole, lambda xy: np.round(xy, DIGITS))


def _parts(ground: BaseGeometry) -> list[BaseGeometry]:
    """The polygons of a footprint, each moved by whole turns to within 180 degrees of longitude."""
    world = shapely.box(-180, -90, 180, 90)
    moved = [translate(ground, turn) for turn in (-720.0, -360.0, 0.0, 360.0, 720.0)]
    parts = shapely.get_parts([shapely.intersection(each, world) for each in moved])
    return [part for part in parts if part.area > 0]


def _pole(side: ImagePolygons) -> float:
    """The latitude of the pole that a photograph shows, whose border goes round it."""
    latitudes = np.array([-90.0, 90.0])
    spots = from_world(side.geo, (side.width, side.height), WGS84, np.c_[np.zeros(2), latitudes])
    shown = latitudes[((spots >= 0) & (spots <= (side.width, side.height))).all(axis=1)]
    if len(shown) != 1:
        raise InputError(f"the border of {side.path} goes round the Earth, but not round one pole: correct its place")
    return float(shown[0])


def _within(longitude: float) -> float:
    return longitude if -180 <= longitude <= 180 else (longitude + 180) % 360 - 180


def _taken(photographs: Sequence[str | None]) -> Times:
    found = []
    for path in photographs:
        moment = None if path is None else taken(Path(path))
        if moment is None:
            raise InputError(f"{path} does not say when it was taken: give --datetime, a moment or START/END")
        found.append(moment)
    return min(found), max(found)


def _projection(side: ImagePolygons) -> dict[str, object]:
    """The fields of the projection extension for a photograph."""
    found: dict[str, object] = {"proj:shape": [side.height, side.width]}
    crs, matrix = side.geo.crs, side.geo.transform
    if crs is None or matrix is None:
        return found
    named = {"proj:code": crs} if crs.startswith("EPSG:") else {"proj:code": None, "proj:wkt2": wkt2(crs)}
    return {**named, **found, "proj:transform": [float(value) for value in matrix.ravel()]}


def _href(file: Path, home: Path) -> str:
    """A file as seen from a folder, with /; its URI on another drive."""
    try:
        return Path(os.path.relpath(os.path.abspath(file), os.path.abspath(home))).as_posix()
    except ValueError:
        return Path(os.path.abspath(file)).as_uri()


def _text(moment: datetime) -> str:
    return moment.astimezone(UTC).replace(microsecond=0).isoformat().replace("+00:00", "Z")
