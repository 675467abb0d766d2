"""Contact sheets of tracks: one region in all its photographs, to be judged by eye."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.files.record import make_folder
from zpm2.files.writing import atomic_write
from zpm2.model import Polygon
from zpm2.photos.pictures import png
from zpm2.photos.source import open_source
from zpm2.tracking.files import keep_only
from zpm2.tracking.photographs import Photograph
from zpm2.view.contact import Crop, contact_sheet
from zpm2.view.pictures import crop

FOLDER = "sheets"


@dataclass(frozen=True, eq=False)
class Shown:
    """A track to be shown."""

    id: int
    seen: Mapping[int, tuple[Polygon, str]]  # by row of the photograph; the region, and what is said of it


def write_sheets(
    folder: Path, photographs: Sequence[Photograph], tracks: Sequence[Shown], raster: RasterConfig
) -> None:
    """Writes `sheets/track_<id>.png`."""
    place, names = make_folder(folder / FOLDER), [f"track_{track.id:05d}.png" for track in tracks]
    for name, picture in zip(names, sheets(photographs, tracks, raster), strict=True):
        atomic_write(place / name, png(picture))
    keep_only(place, names)


def sheets(photographs: Sequence[Photograph], tracks: Sequence[Shown], raster: RasterConfig) -> list[NDArray[np.uint8]]:
    """(h, w, 3) of each track. Each photograph is opened once."""
    crops: list[dict[int, Crop]] = [{} for _ in tracks]
    for row, photograph in enumerate(photographs):
        wanted = [k for k, track in enumerate(tracks) if row in track.seen]
        if wanted:
            with closing(open_source(photograph.path, "photograph", raster)) as source:
                for k in wanted:
                    crops[k][row] = crop(source, photograph.width, tracks[k].seen[row][0])
    return [
        contact_sheet(
            [(each,) for each in crops[k].values()],
            [f"{photographs[row].name}  {track.seen[row][1]}" for row in crops[k]],
        )
        for k, track in enumerate(tracks)
    ]
