"""What following regions gives: tracks over photographs, and the files of that."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig, recorded
from zpm2.files.photo_paths import photo_reference
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.convert import Members
from zpm2.formats.saving import REPORT, Files, write_report
from zpm2.model import Polygon
from zpm2.model.brief import brief
from zpm2.runtime import package_version
from zpm2.tracking import files, sheets
from zpm2.tracking.events import Event
from zpm2.tracking.photographs import Photograph
from zpm2.view.report import tracks as tracks_page

SCHEMA, DOCUMENT = "zpm2-tracks/1", "tracks.json"
SHEETS = 20  # contact sheets that are written unless the caller says otherwise


@dataclass(frozen=True, eq=False)
class SeenRegion:
    """A region in one photograph."""

    polygon: Polygon  # image px; its id is that of the track
    confidence: float  # 0..1, of the best match that has it
    carried: bool  # found there by `carry` only


@dataclass(frozen=True, eq=False)
class RegionTrack:
    """A region followed through photographs."""

    id: int  # from 1 on: by the first photograph, then from top to bottom, from left to right
    seen: Mapping[int, SeenRegion]  # by row of the photograph, ascending
    absent: Mapping[int, str]  # the same, where it was looked for in vain: outside, hidden, not found, or unsure
    closed: int  # matches that close a cycle: they confirm what the others say

    @property
    def center(self) -> tuple[float, float]:
        """x, y px in the first photograph."""
        x, y = next(iter(self.seen.values())).polygon.center
        return float(x), float(y)


@dataclass(frozen=True)
class PairSummary:
    """What a pair of photographs gave."""

    left: int  # row of the photograph
    right: int
    matches: int
    contradicted: int  # of these, left out because more confident ones say otherwise
    carried: int  # further ones, by `carry`


@dataclass(frozen=True, eq=False)
class TracksResult:
    """Regions followed through photographs. The photographs are in the natural order of their names."""

    photographs: Sequence[Photograph]
    tracks: Sequence[RegionTrack]  # by id
    events: Sequence[Event]
    pairs: Sequence[PairSummary]
    chosen: str  # how the pairs were chosen
    config: Mapping[str, object] = field(repr=False)
    timings: Mapping[str, float] = field(default_factory=dict, repr=False)  # stage -> seconds
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()

    __repr__ = brief

    def lengths(self) -> dict[int, int]:
        """How many tracks there are in each number of photographs."""
        counts = np.bincount([len(track.seen) for track in self.tracks])
        return {n: int(count) for n, count in enumerate(counts) if count}

    def polygons(self, photograph: int) -> list[Polygon]:
        """The polygons of a photograph (its row), by the ids of their tracks."""
        return [track.seen[photograph].polygon for track in self.tracks if photograph in track.seen]

    def to_dict(self) -> Members:
        """The content of `tracks.json` (schema "zpm2-tracks/1")."""
        names = [each.name for each in self.photographs]
        return {
            "schema": SCHEMA,
            "version": package_version(),
            "config": dict(self.config),
            "photographs": [
                {"name": each.name, "path": each.path, "width": each.width, "height": each.height}
                for each in self.photographs
            ],
            "tracks": [
                {
                    "id": track.id,
                    "closed": track.closed,
                    "seen": [_seen(names[row], seen) for row, seen in track.seen.items()],
                    "absent": {names[row]: why for row, why in track.absent.items()},
                }
                for track in self.tracks
            ],
            "events": [
                {
                    "kind": event.kind,
                    "whole": event.whole,
                    "parts": list(event.parts),
                    "whole_in": names[event.whole_in],
                    "parts_in": names[event.parts_in],
                }
                for event in self.events
            ],
            "chosen": self.chosen,
            "pairs": [
                {
                    "left": names[pair.left],
                    "right": names[pair.right],
                    "matches": pair.matches,
                    "contradicted": pair.contradicted,
                    "carried": pair.carried,
                }
                for pair in self.pairs
            ],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def sheet(self, track: int) -> NDArray[np.uint8]:
        """(h, w, 3) the region of a track (its id) in all its photographs. `InputError` where one cannot be read."""
        return next(iter(sheets.sheets(self.photographs, [self._plain(track)], self._raster())))

    def save(self, directory: str | Path, sheet_count: int = SHEETS, report: bool = False) -> Path:
        """Writes `labels/<photograph>.png`, `coco.json`, `tracks.csv`, `sheets/track_<id>.png` of the `sheet_count`
        longest tracks, if asked for `report.html`, and at last `tracks.json`, into a folder, which is made; returns it.

        Files of an earlier run are replaced, others never. `OutputError`, and `InputError` where a photograph cannot be
        read again.
        """
        folder = claim(directory, file_names(), [each.path for each in self.photographs])
        rows = [(track.id, row, seen) for track in self.tracks for row, seen in track.seen.items()]
        files.write_labels(folder, self.photographs, [self.polygons(row) for row in range(len(self.photographs))])
        files.write_coco(folder, self.photographs, rows)
        files.write_table(folder, self.photographs, rows)
        longest = sorted(self.tracks, key=lambda track: (-len(track.seen), track.id))[:sheet_count]
        shown = [self._plain(track.id) for track in longest]
        sheets.write_sheets(folder, self.photographs, shown, self._raster())
        document = self.to_dict()
        for each in document["photographs"]:
            each |= photo_reference(each["path"], folder)
        write_report(folder, self._report(document) if report else ())
        atomic_write(folder / DOCUMENT, json.dumps(document, allow_nan=False))
        return folder

    def _report(self, document: Members) -> Files:
        yield REPORT, tracks_page.page(self.photographs, self.tracks, document, self.timings, self._raster())

    def _plain(self, id: int) -> sheets.Shown:
        track = self.tracks[id - 1]
        return sheets.Shown(id, {row: (seen.polygon, said(seen)) for row, seen in track.seen.items()})

    def _raster(self) -> RasterConfig:
        return recorded(self.config).raster


def said(seen: SeenRegion) -> str:
    """How a region came into its track, and how sure that is."""
    return f"{'carried' if seen.carried else 'matched'} {seen.confidence:.2f}"


def file_names() -> list[str]:
    """The names of all files and folders that `TracksResult.save` writes."""
    return [files.LABELS, files.COCO, files.TABLE, sheets.FOLDER, REPORT, DOCUMENT]


def _seen(name: str, seen: SeenRegion) -> Members:
    rings = [ring.round(3).tolist() for ring in (seen.polygon.exterior, *seen.polygon.holes)]
    return {
        "photograph": name,
        "confidence": round(seen.confidence, 4),
        "how": "carried" if seen.carried else "matched",
        "area": round(seen.polygon.area, 3),
        "vertices": rings[0],
        "holes": rings[1:],
    }
