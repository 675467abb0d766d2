"""The report of tracks: a strip of close-ups for each region, beside the photographs with all of them."""

import gzip
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Protocol

import numpy as np

from zpm2.config import RasterConfig
from zpm2.formats.convert import Members
from zpm2.model import Polygon
from zpm2.photos.source import open_source, reduced
from zpm2.view.palette import distinct_colors
from zpm2.view.report import content
from zpm2.view.report.assets import data_url, picture_url, render
from zpm2.view.report.build import HELD, LONGEST

AREA = 24e6  # px of all photographs in the page; more are reduced further


class Photograph(Protocol):
    """A photograph of the run."""

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...


class Seen(Protocol):
    """A region in one photograph."""

    @property
    def polygon(self) -> Polygon: ...
    @property
    def confidence(self) -> float: ...
    @property
    def carried(self) -> bool: ...


class Track(Protocol):
    """A region through photographs: by the row of the photograph, where it is seen, and where it is not and why."""

    @property
    def id(self) -> int: ...
    @property
    def seen(self) -> Mapping[int, Seen]: ...
    @property
    def absent(self) -> Mapping[int, str]: ...
    @property
    def closed(self) -> int: ...


def page(
    photographs: Sequence[Photograph],
    tracks: Sequence[Track],
    document: Members,
    timings: Mapping[str, float],
    config: RasterConfig,
) -> str:
    """The HTML of the page: the same result gives the same text, but for its element `timings`.

    document: the content of `tracks.json`, which the page offers for download. timings: seconds by stage. config: how
    the photographs are read; each is opened once, at the size shown. `InputError` where one cannot be read.
    """
    shown, scales = [], []
    longest = _longest(photographs)
    for photograph in photographs:
        with closing(open_source(photograph.path, "photograph", config)) as source:
            picture = reduced(source, longest).rgb
        shown.append(picture_url(picture))
        scales.append(np.array(picture.shape[1::-1]) / (photograph.width, photograph.height))
    data = {
        "steps": content.STEPS,
        "photographs": [
            {"name": each.name, "path": each.path, "width": each.width, "height": each.height, "scale": scale.tolist()}
            for each, scale in zip(photographs, scales, strict=True)
        ],
        "tracks": [
            {
                "id": track.id,
                "color": content.hex_color(color),
                "closed": track.closed,
                "absent": [[row, why] for row, why in track.absent.items()],
                "seen": [
                    {
                        "photograph": row,
                        "confidence": round(seen.confidence, 4),
                        "carried": seen.carried,
                        "area": round(seen.polygon.area, 1),
                        "rings": content.rings(seen.polygon, scales[row]),
                    }
                    for row, seen in track.seen.items()
                ],
            }
            for track, color in zip(tracks, _colors(photographs, tracks), strict=True)
        ],
        "run": content.run(document) | {"chosen": document["chosen"], "pairs": len(document["pairs"])},
    }
    text = json.dumps(document, allow_nan=False).encode()
    return render(
        "tracks.html",
        "tracks.js",
        data,
        title=f"{len(tracks)} tracks in {len(photographs)} photographs",
        pictures=[{"name": str(row), "url": url} for row, url in enumerate(shown)],
        document=data_url("application/gzip", gzip.compress(text, 6, mtime=0)) if len(text) <= HELD else "",
        timings=json.dumps({stage: round(seconds, 4) for stage, seconds in timings.items()}),
    )


def _longest(photographs: Sequence[Photograph]) -> int:
    """px, the longer side at which the photographs are shown."""
    areas = sum(each.width * each.height / max(each.width, each.height) ** 2 for each in photographs)
    return max(1, min(LONGEST, int(np.sqrt(AREA / max(areas, 1e-9)))))


def _colors(photographs: Sequence[Photograph], tracks: Sequence[Track]) -> list[content.Color]:
    """Of the tracks: different from those near in the photographs, by the mean of their places there."""
    boxes = [
        np.mean([np.array(seen.polygon.bounds) / _longer(photographs[row]) for row, seen in track.seen.items()], axis=0)
        for track in tracks
    ]
    bounds = np.array(boxes).reshape(-1, 2, 2)
    return distinct_colors(bounds.mean(1), np.ptp(bounds, axis=1).max(1, initial=0) / 2)


def _longer(photograph: Photograph) -> int:
    return max(photograph.width, photograph.height)
