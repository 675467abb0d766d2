"""The files of tracks for other tools: label images, COCO, a table."""

import csv
import io
import json
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import numpy as np

from zpm2.errors import OutputError
from zpm2.files.listing import distinct_stems
from zpm2.files.record import make_folder, remove_own
from zpm2.files.writing import atomic_write
from zpm2.formats.coco import CONTRIBUTOR, REGION, pixels
from zpm2.formats.regions.labels import LabelImage
from zpm2.formats.regions.region import CarriedRegion, GivenRegion
from zpm2.model import Polygon
from zpm2.polygons.rasterize import rasterize
from zpm2.tracking.photographs import Photograph

LABELS, COCO, TABLE = "labels", "coco.json", "tracks.csv"
COLUMNS = ("track", "photograph", "x", "y", "area", "confidence", "how")


class Seen(Protocol):
    """A region in one photograph."""

    @property
    def polygon(self) -> Polygon: ...
    @property
    def confidence(self) -> float: ...
    @property
    def carried(self) -> bool: ...


Row = tuple[int, int, Seen]  # id of the track, row of the photograph, the region there


def write_labels(folder: Path, photographs: Sequence[Photograph], polygons: Sequence[Sequence[Polygon]]) -> None:
    """A label image of each photograph: the number of a pixel is the id of its track, 0 for none. 16 bit, and TIFF of
    32 bit where there are more than 65535 tracks. Where regions overlap, the smallest is on top."""
    most = max((polygon.id for each in polygons for polygon in each), default=0)
    ending, dtype = (".png", np.uint16) if most < 2**16 else (".tif", np.uint32)
    place, names = make_folder(folder / LABELS), list[str]()
    stems = distinct_stems([Path(each.path) for each in photographs])
    for stem, photograph, own in zip(stems, photographs, polygons, strict=True):
        names.append(stem + ending)
        regions = [CarriedRegion(GivenRegion((), polygon.id), polygon.shape) for polygon in own]
        LabelImage(place / names[-1], np.zeros((0, 0), dtype), []).write(place / names[-1], regions, photograph)
    keep_only(place, names)


def write_coco(folder: Path, photographs: Sequence[Photograph], rows: Sequence[Row]) -> None:
    """One COCO file of all photographs; "track_id" of each annotation is the id of its track."""
    annotations = [
        {
            "id": number,
            "image_id": row + 1,
            "category_id": 1,
            "track_id": track,
            "score": round(seen.confidence, 4),
            "how": how(seen),
            **pixels(rasterize(seen.polygon.shape), photographs[row].width, photographs[row].height),
            "iscrowd": 0,
        }
        for number, (track, row, seen) in enumerate(rows, start=1)
    ]
    document = {
        "info": {"contributor": CONTRIBUTOR},
        "images": [
            {"id": k, "file_name": each.name, "width": each.width, "height": each.height}
            for k, each in enumerate(photographs, start=1)
        ],
        "categories": [{"id": 1, "name": REGION}],
        "annotations": annotations,
    }
    atomic_write(folder / COCO, json.dumps(document, allow_nan=False))


def write_table(folder: Path, photographs: Sequence[Photograph], rows: Sequence[Row]) -> None:
    """A line for each region of each track: its area centroid in px, where COLMAP has its origin, too (pixel centres
    at 0.5), and its area, px^2."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for track, row, seen in rows:
        numbers = [f"{value:.3f}" for value in (*seen.polygon.center, seen.polygon.area)]
        table.writerow([track, photographs[row].name, *numbers, f"{seen.confidence:.4f}", how(seen)])
    atomic_write(folder / TABLE, text.getvalue())


def how(seen: Seen) -> str:
    """How the region came into its track."""
    return "carried" if seen.carried else "matched"


def keep_only(folder: Path, names: Collection[str]) -> None:
    """Removes the other files of a folder that an earlier run made."""
    for file in sorted(folder.iterdir()):
        if file.name not in names:
            with suppress(OutputError):  # not made by a run
                remove_own(file)
