"""The photographs of a run, in one order whatever order they were given in, and where they were taken."""

import os
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.errors import InputError
from zpm2.files.keys import fingerprint
from zpm2.files.listing import distinct_names, natural
from zpm2.files.reading import WRONG
from zpm2.model import Georeference
from zpm2.photos import pictures
from zpm2.photos.listing import some_photographs
from zpm2.photos.source import Source, open_source

GPS_IFD, LAT_REF, LAT, LON_REF, LON = 0x8825, 1, 2, 3, 4  # of EXIF
EARTH = 6371e3  # m, mean radius


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph of a run."""

    name: str  # unique in its run (`files.listing.distinct_names`)
    path: str
    width: int  # px
    height: int  # px
    geo: Georeference = field(default_factory=Georeference, repr=False)
    position: NDArray[np.float64] | None = field(default=None, repr=False)  # (2,) degrees, longitude and latitude


def listed(given: Sequence[str | Path]) -> list[Path]:
    """The photographs, and those of folders among them."""
    return [
        path for place in map(Path, given) for path in (some_photographs(place) if os.path.isdir(place) else [place])
    ]


def read_photographs(given: Sequence[str | Path], raster: RasterConfig) -> list[Photograph]:
    """The photographs, and those of folders among them, in the natural order of their names.

    Each is opened once, so that `InputError` names an unusable one before the work begins; also for fewer than two, and
    for one that was given twice.
    """
    paths = listed(given)
    names = distinct_names(paths)
    order = sorted(range(len(paths)), key=lambda k: [natural(Path(part)) for part in names[k].split("/")])
    found, by_content = list[Photograph](), dict[str, str]()
    for k in order:
        path = paths[k]
        with closing(open_source(path, "photograph", raster)) as source:
            content, position = fingerprint(path), _position(path, source)
            if content in by_content:
                raise InputError(f"{path} and {by_content[content]} are the same photograph: give it once")
            by_content[content] = str(path)
            found.append(Photograph(names[k], str(path), source.width, source.height, source.geo, position))
    if len(found) < 2:
        raise InputError(f"{len(found)} photograph given: tracks need at least two, or a folder of them")
    return found


def distances(photographs: Sequence[Photograph]) -> NDArray[np.float64] | None:
    """(n, n) m between the places where they were taken; None unless all have one, and not all the same."""
    known = [each.position for each in photographs if each.position is not None]
    if len(known) < len(photographs):
        return None
    lon, lat = np.radians(np.array(known)).T
    places = EARTH * np.c_[np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    return apart if apart.any() else None


def _position(path: Path, source: Source) -> NDArray[np.float64] | None:
    """Longitude and latitude: of the middle of a georeferenced photograph, else of the camera, from EXIF."""
    if source.placed:
        (middle,) = source.to_lon_lat(np.array([[source.width / 2, source.height / 2]]))
        return middle if np.isfinite(middle).all() else None
    try:
        with pictures.looked_at(path) as picture:
            tags = pictures.exif_of(picture).get_ifd(GPS_IFD)
        found = np.array([_degrees(tags[LON], tags[LON_REF]), _degrees(tags[LAT], tags[LAT_REF])])
    except (*pictures.DAMAGE, *WRONG):  # none, or not as they should be
        return None
    return found if np.isfinite(found).all() and abs(found[0]) <= 180 and abs(found[1]) <= 90 else None


def _degrees(values: Sequence[float], half: str) -> float:
    degrees, minutes, seconds = (float(value) for value in values)
    return (degrees + minutes / 60 + seconds / 3600) * (-1 if half in ("S", "W") else 1)
