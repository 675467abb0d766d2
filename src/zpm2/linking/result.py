"""What linking gives: which polygon of one layer is which of the other, and the files of that."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from zpm2.errors import Failed
from zpm2.files.photo_paths import absolute
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.convert import Members
from zpm2.formats.regions.region import CarriedRegion
from zpm2.formats.regions.registry import write_regions, written_names
from zpm2.formats.regions.shifts import Shift, write_shifts
from zpm2.linking.layer import Ground, Layer
from zpm2.linking.similarity import Similarity, Uncertainty
from zpm2.model.brief import brief
from zpm2.photos.geolocation import WGS84, between
from zpm2.runtime import package_version

SCHEMA, DOCUMENT, SHIFTS = "zpm2-links/1", "links.json", "shifts.geojson"
METERS, SHARES = 3, 4  # decimals


@dataclass(frozen=True)
class Link:
    """One polygon in both layers."""

    left: int  # row of the left layer
    right: int  # row of the right layer
    confidence: float  # 0..1
    start: tuple[float, float]  # m in the result's frame: centre of the left polygon
    end: tuple[float, float]  # m, centre of the right one
    residual: float  # m that is left of the shift, once similarity and local variation are taken off
    same_shape: float  # 0..1, IoU of the outlines with the centres laid on each other

    @property
    def shift(self) -> tuple[float, float]:
        """m to the east and north, from the left to the right polygon."""
        return self.end[0] - self.start[0], self.end[1] - self.start[1]


@dataclass(frozen=True, eq=False)
class LinkResult:
    """The links of two layers, by ascending left row. Rows are those of the layers' `regions`.

    Metres are those of `frame`, an azimuthal equidistant reference system around the left layer.
    """

    left: Layer
    right: Layer
    frame: str
    similarity: Similarity | Failed  # from left to right, m
    uncertainty: Uncertainty | None  # of the similarity; None without one
    links: Sequence[Link]
    unmatched: tuple[Mapping[int, str], Mapping[int, str]]  # left and right: row -> why it has no link
    parts: tuple[Mapping[int, Sequence[int]], Mapping[int, Sequence[int]]]  # row -> rows of the other layer, its parts
    config: Mapping[str, object] = field(default_factory=dict, repr=False)
    timings: Mapping[str, float] = field(default_factory=dict)  # stage -> seconds
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()

    __repr__ = brief

    def ids(self) -> list[tuple[str, str]]:
        """The links by the ids that the files have (else rows), as text."""
        return [(self.left.name(link.left), self.right.name(link.right)) for link in self.links]

    def reasons(self) -> dict[str, dict[str, int]]:
        """How many polygons of each side have no link, by reason."""
        sides = zip(("left", "right"), self.unmatched, strict=True)
        return {side: dict(Counter(reasons.values()).most_common()) for side, reasons in sides}

    def save(self, directory: str | Path) -> Path:
        """Writes `regions.<ending of the left file>`, the left layer with its links as attributes, `shifts.geojson`, a
        line for each link, and `links.json`, last, into a folder, which is made; returns it. `OutputError`."""
        inputs = [layer.file.path for layer in (self.left, self.right)]
        folder = claim(directory, file_names(self.left), inputs)
        notes = [*self.notes, *write_regions(folder, self.left.file, self._carried(), self.left.ground)]
        ground = Ground.of(self.left.file.path, self.frame)
        write_shifts(folder / SHIFTS, self._shifts(), ground, ground)
        atomic_write(folder / DOCUMENT, json.dumps(self.to_dict() | {"notes": notes}, allow_nan=False))
        return folder

    def to_dict(self) -> Members:
        """The content of `links.json`."""
        sides = (("left", self.left, self.right), ("right", self.right, self.left))
        return {
            "schema": SCHEMA,
            "version": package_version(),
            "config": dict(self.config),
            "timings": {stage: round(seconds, 4) for stage, seconds in self.timings.items()},
            **{
                name: {
                    "path": absolute(str(layer.file.path)),
                    "crs": layer.ground.geo.crs,
                    "polygons": len(layer.regions),
                }
                for name, layer, _ in sides
            },
            "frame": self.frame,
            "similarity": self._similarity(),
            "failed": {"similarity": str(self.similarity)} if isinstance(self.similarity, Failed) else {},
            "links": [self._link(link) for link in self.links],
            "parts": {
                name: [{**_named(of, row), "parts": [_named(other, part) for part in parts]} for row, parts in each]
                for (name, of, other), each in zip(sides, (p.items() for p in self.parts), strict=True)
            },
            "unmatched": {
                name: [{**_named(of, row), "reason": reason} for row, reason in reasons.items()]
                for (name, of, _), reasons in zip(sides, self.unmatched, strict=True)
            },
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _similarity(self) -> Members | None:
        if isinstance(self.similarity, Failed) or self.uncertainty is None:
            return None
        found, sigma = self.similarity, self.uncertainty
        return {
            "center": _rounded(found.center, METERS),
            "center_lon_lat": _rounded(between(self.frame, WGS84, found.center[None])[0], 8),
            "shift": _rounded(found.shift, METERS),
            "turn": round(found.turn, 5),
            "scale": round(found.scale, 7),
            "sigma": {
                "shift": round(sigma.shift, 4),
                "turn": round(sigma.turn, 6),
                "scale": round(sigma.scale, 8),
                "residual": round(sigma.residual, METERS),
            },
        }

    def _link(self, link: Link) -> Members:
        left, right = _named(self.left, link.left), _named(self.right, link.right)
        return {"left": left["id"], "right": right["id"], "left_row": left["row"], "right_row": right["row"]} | _of(
            link
        )

    def _carried(self) -> list[CarriedRegion]:
        """The left layer with its links."""
        link_of = {link.left: link for link in self.links}
        carried = []
        for row, (region, outline) in enumerate(zip(self.left.regions, self.left.outlines, strict=True)):
            link, parts = link_of.get(row), self.parts[0].get(row)
            values = dict.fromkeys(("confidence", "dx", "dy", "residual", "same_shape"))
            attributes = {
                "partner": None if link is None else self.right.name(link.right),
                "partner_row": None if link is None else self.right.regions[link.right].row,
                **(values if link is None else _of(link)),
                "unmatched": self.unmatched[0].get(row),
                "parts": None if parts is None else [self.right.name(part) for part in parts],
            }
            carried.append(CarriedRegion(region, outline, attributes))
        return carried

    def _shifts(self) -> list[Shift]:
        sigma = None if self.uncertainty is None else self.uncertainty.residual
        return [
            Shift(self.left.regions[link.left], np.array(link.start), np.array(link.end), sigma) for link in self.links
        ]


def file_names(left: Layer) -> list[str]:
    """The names of all files that `LinkResult.save` may write for that left layer."""
    return [*written_names(left.file), SHIFTS, DOCUMENT]


def _named(layer: Layer, row: int) -> Members:
    return {"id": layer.regions[row].source_id, "row": layer.regions[row].row}


def _of(link: Link) -> Members:
    """What we say of a link in every file."""
    dx, dy = link.shift
    return {
        "confidence": round(link.confidence, SHARES),
        "dx": round(dx, METERS),
        "dy": round(dy, METERS),
        "residual": round(link.residual, METERS),
        "same_shape": round(link.same_shape, SHARES),
    }


def _rounded(values: np.ndarray, decimals: int) -> list[float]:
    return [round(float(value), decimals) for value in values]
