"""What a person accepted, as a result of `zpm2 match`, in the same files."""

import io
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from zpm2.app.pair import Pair
from zpm2.app.prompt import shape_from, share
from zpm2.errors import InputError
from zpm2.files.reading import WRONG
from zpm2.formats.properties import plain
from zpm2.formats.regions.outlines import parts_of
from zpm2.formats.regions.region import Shape
from zpm2.model import ImagePolygons, Polygon, PolygonMatch
from zpm2.polygons.repair import largest
from zpm2.polygons.shapes import from_shape, reshaped
from zpm2.result import MatchResult

FOLDER = "zpm2-app"  # in the archive
REJECTED = "rejected"  # why polygons of a match that a person rejected have no partner
LONGEST_LABEL = 1000


@dataclass(frozen=True, eq=False)
class Region:
    """A region on which a person decided."""

    match: int | None  # id of the match of the opened result; None: a new region
    accepted: bool
    label: str | None
    shapes: tuple[Shape, Shape] | None  # px of either photograph; None: as the opened result has them
    agreement: float  # 0..1, `Outcome.agreement`
    visible: float | None  # 0..1, `Outcome.visible`
    points: int  # `Outcome.points`


def region_of(value: object) -> Region:
    """A region as the page sends it. `InputError` for anything else."""
    try:
        if not isinstance(value, Mapping):
            raise TypeError("a region is no object")
        match, label, points = value.get("match"), value.get("label"), value.get("points", 0)
        if not isinstance(match, int | None) or not isinstance(label, str | None) or not isinstance(points, int):
            raise TypeError("a region has a match, a label or points of a wrong type")
        if label is not None and plain(label) != label:
            raise ValueError(f"the label {label!r:.99} has a character that no file can hold: type it again")
        shapes = None
        if value.get("left") is not None:
            shapes = shape_from(value["left"]), shape_from(value["right"])
        elif match is None:
            raise TypeError("a region has no outline")
        visible = None if value.get("visible") is None else share(value["visible"])
        return Region(
            match,
            value["accepted"] is True,
            (label or "")[:LONGEST_LABEL] or None,
            shapes,
            share(value.get("agreement", 0.0)),
            visible,
            min(max(points, 0), 2**31),
        )
    except WRONG as error:
        raise InputError(f"the regions cannot be exported: {error}") from error


def result_of(pair: Pair, regions: Sequence[Region], opened: MatchResult | None) -> MatchResult:
    """The accepted regions as matches with confidence 1, as a person confirmed them.

    opened: the result that the regions were begun from. Its other polygons and matches stay as they are; those of a
    match that the person rejected have no partner any more. Of a region with several parts, the largest is a polygon of
    the result; a note says of how many. It is not `non_overlapping` any more where a region brings shapes of its own.
    """
    base = _empty(pair) if opened is None else opened
    left = {polygon.id: polygon for polygon in base.left.polygons}
    right = {polygon.id: polygon for polygon in base.right.polygons}
    matches = {match.id: match for match in base.matches}
    unmatched = dict(base.left.unmatched), dict(base.right.unmatched)
    confirmed = cut = 0
    for region in regions:
        before = None if region.match is None else matches.get(region.match)
        if region.match is not None and before is None:
            raise InputError(f"the opened result has no match {region.match}")
        if not region.accepted:
            if before is not None:
                del matches[before.id]
                unmatched[0][before.left] = unmatched[1][before.right] = REJECTED
            continue
        confirmed += 1
        if before is not None and region.shapes is None:
            matches[before.id] = replace(before, confidence=1.0)
            continue
        assert region.shapes is not None
        cut += any(len(parts_of(shape)) > 1 for shape in region.shapes)
        ids = (max(left, default=-1) + 1, max(right, default=-1) + 1) if before is None else (before.left, before.right)
        for polygons, number, shape in zip((left, right), ids, region.shapes, strict=True):
            polygons[number] = _polygon(polygons.get(number), number, shape, region.label)
        visible = 1.0 if region.visible is None else region.visible
        cost = 1 - region.agreement if region.agreement < 1 else 1e-6  # as `carry.contest`, and above 0
        matches[ids[0]] = PolygonMatch(
            *ids, 1.0, cost, region.points, "guided", overlap=region.agreement, visible=visible
        )
    notes = [*base.notes, f"a person confirmed {confirmed} matches in zpm2 app: their confidence is 1"]
    if cut:
        notes.append(f"{cut} regions have several parts: the largest one of each is in the result")
    return replace(
        base,
        left=replace(base.left, polygons=list(left.values()), unmatched=unmatched[0]),
        right=replace(base.right, polygons=list(right.values()), unmatched=unmatched[1]),
        matches=sorted(matches.values(), key=lambda match: match.left),
        notes=notes,
        non_overlapping=base.non_overlapping and not any(each.accepted and each.shapes for each in regions),
    )


def archive(result: MatchResult, formats: Sequence[str]) -> bytes:
    """The folder that `MatchResult.save` writes, with the report, as a ZIP file. Errors are those of `save`."""
    with tempfile.TemporaryDirectory(prefix="zpm2-app-") as scratch:
        folder = result.save(Path(scratch) / FOLDER, formats, report=True)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
            for path in sorted(folder.rglob("*")):
                name = path.relative_to(folder)
                if path.is_file() and not name.parts[0].startswith("."):  # without the record of what was made
                    file.writestr(zipfile.ZipInfo(f"{FOLDER}/{name.as_posix()}"), path.read_bytes())
        return packed.getvalue()


def _empty(pair: Pair) -> MatchResult:
    """The photographs and their geometry, without polygons."""
    left, right = (
        ImagePolygons(each.width, each.height, [], each.path, each.image, each.geo) for each in pair.photographs
    )
    points, notes = pair.every_point, [str(message) for message in pair.messages]
    config = pair.config.to_dict()
    return MatchResult(left, right, [], points, pair.fundamental, pair.homography, config, {}, notes=notes)


def _polygon(before: Polygon | None, number: int, shape: Shape, label: str | None) -> Polygon:
    part = from_shape(largest(shape), number, label=label)
    return part if before is None else replace(reshaped(before, part.shape), label=label)
