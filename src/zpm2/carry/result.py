"""What carrying gives: each given region in the other photograph, and the files of that."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import PIL.Image
import shapely
from numpy.typing import NDArray

from zpm2.carry.outcome import Outcome
from zpm2.carry.report import report_files
from zpm2.config import RasterConfig
from zpm2.files.photo_paths import absolute, photo_reference
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.convert import Members
from zpm2.formats.properties import plain
from zpm2.formats.regions.outlines import parts_of, rings_of
from zpm2.formats.regions.region import CarriedRegion, GivenRegion, RegionFile, Shape
from zpm2.formats.regions.registry import write_regions, written_names
from zpm2.formats.regions.shifts import Shift, has_shifts, write_shifts
from zpm2.formats.saving import REPORT, TILES, Files, write_report
from zpm2.model import Georeference, ImagePolygons, Polygon, PolygonMatch
from zpm2.model.brief import brief
from zpm2.photos.geolocation import meters_between, world_of
from zpm2.photos.pictures import png
from zpm2.photos.reopen import pixels
from zpm2.polygons.repair import largest
from zpm2.polygons.shapes import from_shape
from zpm2.runtime import package_version
from zpm2.view.overlay import overlay

SCHEMA, DOCUMENT, PICTURE, SHIFTS = "zpm2-carry/1", "carry.json", "overlay.png", "shifts.geojson"
PICTURE_WIDTH = 2400  # px


@dataclass(frozen=True, eq=False)
class Side:
    """One photograph of a result."""

    path: str | None
    width: int  # px
    height: int  # px
    geo: Georeference = field(default_factory=Georeference)


@dataclass(frozen=True, eq=False)
class CarryResult:
    """The given regions of `left` in `right`: row k of `regions`, `shapes` and `outcomes` is one region.

    `save` writes the regions in the format that they came in, `carry.json` with all that is known of each, and a
    picture.
    """

    left: Side
    right: Side
    regions: Sequence[GivenRegion]
    shapes: Sequence[Shape | None]  # left px; None where the file's region has no area
    outcomes: Sequence[Outcome]
    config: Mapping[str, object] = field(default_factory=dict, repr=False)
    timings: Mapping[str, float] = field(default_factory=dict)  # stage -> seconds
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()
    file: RegionFile | None = field(default=None, repr=False)  # that the regions came from

    __repr__ = brief

    def counts(self) -> dict[str, int]:
        """How many regions have each status."""
        return dict(Counter(outcome.status for outcome in self.outcomes))

    def carried(self) -> list[CarriedRegion]:
        """The regions with their outlines in the right photograph, and our attributes."""
        return [
            CarriedRegion(region, outcome.shape, attributes(outcome))
            for region, outcome in zip(self.regions, self.outcomes, strict=True)
        ]

    def plot(self, max_width: int = PICTURE_WIDTH) -> PIL.Image.Image:
        """Both photographs with the regions in one colour each. `InputError` where one cannot be read again."""
        return PIL.Image.fromarray(self._overlay(max_width))

    def save(self, directory: str | Path, report: bool = False) -> Path:
        """Writes `regions.<ending of what was given>`, `carry.json`, `overlay.png`, of two georeferenced photographs
        `shifts.geojson`, and if asked for `report.html`, into a folder, which is made; returns it. `carry.json` comes
        last. `OutputError`."""
        photographs = [side.path for side in (self.left, self.right) if side.path is not None]
        folder = claim(directory, file_names(self.file), photographs)
        notes = list(self.notes)
        if self.file is not None:
            notes += write_regions(folder, self.file, self.carried(), self.right)
        atomic_write(folder / PICTURE, png(self._overlay(PICTURE_WIDTH)))
        if has_shifts(self.left, self.right):
            write_shifts(folder / SHIFTS, self._shifts(), self.left, self.right)
        document = self.to_dict() | {"notes": notes}
        for side in ("left", "right"):
            document[side] |= photo_reference(document[side]["path"], folder)
        write_report(folder, self._report(document) if report else ())
        atomic_write(folder / DOCUMENT, json.dumps(document, allow_nan=False))
        return folder

    def to_dict(self) -> Members:
        """The content of `carry.json`."""
        return {
            "schema": SCHEMA,
            "version": package_version(),
            "config": dict(self.config),
            "timings": {stage: round(seconds, 4) for stage, seconds in self.timings.items()},
            **{
                name: {"path": absolute(side.path), "width": side.width, "height": side.height}
                for name, side in (("left", self.left), ("right", self.right))
            },
            "counts": self.counts(),
            "regions": [
                {
                    "row": region.row,
                    "id": region.source_id,
                    "label": region.label,
                    **attributes(outcome),
                    "parts": [] if outcome.shape is None else [vertices(part) for part in parts_of(outcome.shape)],
                }
                for region, outcome in zip(self.regions, self.outcomes, strict=True)
            ],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _report(self, document: Members) -> Files:
        left, right = (ImagePolygons(s.width, s.height, [], s.path, geo=s.geo) for s in (self.left, self.right))
        return report_files((left, right), self.regions, self.shapes, self.outcomes, document)

    def _shifts(self) -> list[Shift]:
        meters = self._meters_per_px()
        return [
            Shift(
                region,
                np.array(shape.centroid.coords[0]),
                np.array(outcome.place),
                None if outcome.sigma is None or meters is None else outcome.sigma * meters,
            )
            for region, shape, outcome in zip(self.regions, self.shapes, self.outcomes, strict=True)
            if shape is not None and outcome.shape is not None and outcome.place is not None
        ]

    def _meters_per_px(self) -> float | None:
        world = world_of(self.right.geo)
        if world is None:
            return None
        middle = np.array([[self.right.width / 2, self.right.height / 2]])
        crs, to_world = world
        return float(np.linalg.norm(meters_between(crs, to_world(middle), to_world(middle + np.array([1.0, 0.0])))[0]))

    def _overlay(self, max_width: int) -> NDArray[np.uint8]:
        left, right, matches = list[Polygon](), list[Polygon](), list[PolygonMatch]()
        for k, (shape, outcome) in enumerate(zip(self.shapes, self.outcomes, strict=True)):
            if shape is None:
                continue
            left.append(from_shape(largest(shape), k))
            if outcome.shape is not None:
                right.append(from_shape(largest(outcome.shape), k))
                matches.append(PolygonMatch(k, k, outcome.confidence, 1.0, outcome.points, "guided"))
        sides = []
        for name, side, polygons in (("left", self.left, left), ("right", self.right, right)):
            plain_side = ImagePolygons(side.width, side.height, polygons, side.path, geo=side.geo)
            picture = pixels(plain_side, name, RasterConfig(), max_width)
            sides.append(ImagePolygons(side.width, side.height, polygons, side.path, picture, side.geo))
        return overlay(sides[0], sides[1], matches, max_width)


def file_names(file: RegionFile | None) -> list[str]:
    """The names of all files that `CarryResult.save` may write for regions of that file."""
    return [*(written_names(file) if file is not None else ()), PICTURE, SHIFTS, REPORT, TILES, DOCUMENT]


def attributes(outcome: Outcome) -> dict[str, object]:
    """What we say of a region in every file."""
    values = {
        "status": outcome.status,
        "reason": outcome.reason,
        "confidence": round(outcome.confidence, 4),
        "visible": None if outcome.visible is None else round(outcome.visible, 4),
        "agreement": round(outcome.agreement, 4),
        "points": outcome.points,
        "place": None if outcome.place is None else [round(v, 2) for v in outcome.place],
        "sigma": None if outcome.sigma is None else round(outcome.sigma, 3),
        "alternatives": [[round(v, 2) for v in each] for each in outcome.alternatives],
    }
    return {name: plain(value) for name, value in values.items()}


def vertices(part: shapely.Polygon) -> list[list[list[float]]]:
    """The exterior and the holes, each as [x, y] without the closing one."""
    return [ring[:-1].round(3).tolist() for ring in rings_of(part)]
