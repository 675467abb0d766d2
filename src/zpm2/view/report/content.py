"""What the report page shows of a pair, as plain values for its JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import Failed
from zpm2.formats.registry import PairResult
from zpm2.model import SIDES, ImagePolygons, Polygon, PolygonMatch
from zpm2.view.overlay import OTHER_REASON, REASONS, UNKNOWN
from zpm2.view.palette import distinct_colors

_LIKE = (("outside", "outside overlap"), ("hidden", "occluded"), ("not found", "no candidate"))
CARRIED = {name: REASONS[like] for name, like in _LIKE}  # colours of statuses of carried regions
STEPS = 8  # units of a vertex per px of the picture
TOLERANCE = 0.3  # px of the picture by which a simplified outline may be off

Array = NDArray[np.float64]
Color = tuple[int, int, int]


@dataclass(frozen=True)
class Words:
    """What a page says that is not in a `MatchResult`."""

    document: str = "matches.json"  # name of the file that the page holds
    stages: Mapping[int, str] = field(default_factory=dict)  # match id -> what the page says in the place of its stage
    remarks: Mapping[int, str] = field(default_factory=dict)  # id of a left polygon -> a sentence on what became of it


def pair(result: PairResult, scales: tuple[Array, Array], words: Words) -> dict[str, object]:
    """The polygons, matches and geometry of a pair.

    scales: (2,) px of the sharpest picture that the page shows per px of the photograph, of either side.
    """
    matched = {match.left for match in result.matches}, {match.right for match in result.matches}
    sides = [
        _side(side, name, scale, used, words.remarks if name == "left" else {})
        for side, name, scale, used in zip((result.left, result.right), SIDES, scales, matched, strict=True)
    ]
    colors = _colors(result)
    return {
        "sides": sides,
        "steps": STEPS,
        "scales": [scale.tolist() for scale in scales],
        "matches": [
            _match(match, color) | {"stage": words.stages.get(match.id, match.stage)}
            for match, color in zip(result.matches, colors, strict=True)
        ],
        "document": words.document,
        "fundamental": _matrix(result.fundamental),
        "homography": _matrix(result.homography),
        "reasons": {name: hex_color(color) for name, color in {**REASONS, **CARRIED, UNKNOWN: OTHER_REASON}.items()},
    }


def _side(
    side: ImagePolygons, name: str, scale: Array, matched: set[int], remarks: Mapping[int, str]
) -> dict[str, object]:
    return {
        "name": name,
        "path": side.path,
        "width": side.width,
        "height": side.height,
        "polygons": [
            {
                "id": polygon.id,
                "area": round(polygon.area, 1),
                "score": round(polygon.score, 4),
                "label": polygon.label,
                "parent": polygon.parent,
                "why": None if polygon.id in matched else side.unmatched.get(polygon.id, UNKNOWN),
                "remark": remarks.get(polygon.id),
                "rings": rings(polygon, scale),
            }
            for polygon in side.polygons
        ],
    }


def _match(match: PolygonMatch, color: Color) -> dict[str, object]:
    return {
        "id": match.id,
        "left": match.left,
        "right": match.right,
        "confidence": round(match.confidence, 4),
        "cost": _known(match.cost),
        "dsf": match.dsf,
        "overlap": round(match.overlap, 4),
        "visible": _known(match.visible),
        "color": hex_color(color),
    }


def rings(polygon: Polygon, scale: Array) -> list[list[int]]:
    """Exterior, then holes, as [x, y, dx, dy, dx, dy, ...] in 1/`STEPS` px of the picture, from vertex to vertex.

    Simplified by `TOLERANCE` px; holes that vanish at this scale are left out.
    """
    found = []
    for k, ring in enumerate((polygon.exterior, *polygon.holes)):
        scaled = ring * scale
        simple = shapely.simplify(shapely.LinearRing(scaled), TOLERANCE, preserve_topology=False)
        kept = np.array(simple.coords)[:-1] if not simple.is_empty and len(simple.coords) >= 4 else scaled
        units = np.rint(kept * STEPS).astype(int)
        if k and len(np.unique(units, axis=0)) < 3:
            continue
        found.append(np.diff(units, axis=0, prepend=0).ravel().tolist())
    return found


def _colors(result: PairResult) -> list[Color]:
    """Of the matches: different from those near in either photograph."""
    places = []
    for side, name in zip((result.left, result.right), SIDES, strict=True):
        polygons = {polygon.id: polygon for polygon in side.polygons}
        bounds = np.array([polygons[getattr(match, name)].bounds for match in result.matches]).reshape(-1, 4)
        places.append(bounds / max(side.width, side.height))
    low, high = (np.hstack([bounds[:, part] for bounds in places]) for part in (slice(0, 2), slice(2, 4)))
    return distinct_colors((low + high) / 2, (high - low).max(1, initial=0) / 2)


def _known(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _matrix(matrix: Array | Failed) -> dict[str, object]:
    """An estimate, or why there is none."""
    if isinstance(matrix, Failed):
        return {"matrix": None, "failed": str(matrix)}
    return {"matrix": matrix.tolist(), "failed": None}


def hex_color(color: Iterable[int]) -> str:
    """#rrggbb."""
    return "#" + "".join(f"{value:02x}" for value in color)


def run(document: Mapping[str, object]) -> dict[str, object]:
    """What the page says of the run, but for its timings: from the content of `matches.json`."""
    names: Sequence[str] = ("version", "config", "same_scene", "non_overlapping", "warnings", "notes")
    return {name: document.get(name) for name in names}
