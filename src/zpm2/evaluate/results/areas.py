"""An area of another tool, whatever it is written as: box, outline or pixels, in one piece or in several."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import Failed, InputError
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.polygons.repair import polygons_in
from zpm2.polygons.trace import trace
from zpm2.result import MatchResult

Size = tuple[int, int]  # (width, height) px
NO_GEOMETRY = Failed("another tool's areas")


@dataclass(frozen=True, eq=False)
class Area(Polygon):
    """An area as a polygon that scoring takes: it may have several pieces. `exterior` is that of the largest one;
    `shape`, by which areas are scored, is all of it."""

    pieces: tuple[shapely.Polygon, ...] = ()

    @cached_property
    def shape(self) -> shapely.Polygon | shapely.MultiPolygon:
        """All pieces, image px."""
        return self.pieces[0] if len(self.pieces) == 1 else shapely.MultiPolygon(self.pieces)


Pieces = Sequence[shapely.Polygon]  # of one area, image px of the photograph


@dataclass(frozen=True, eq=False)
class AreaMatches:
    """What a tool found in a pair. An area may be in several matches, and areas may overlap."""

    matches: Sequence[tuple[Pieces, Pieces, float]]  # left area, right area, score 0..1
    others: tuple[Sequence[Pieces], Sequence[Pieces]] = ((), ())  # areas without a match, left and right
    seconds: float | None = None  # that the tool took, where it says so


@dataclass(frozen=True)
class SizedPair:
    """A pair of a data set, as a reader of results needs it."""

    name: str
    sizes: tuple[Size, Size]  # of the left and of the right photograph
    images: tuple[Image, Image] = field(repr=False)  # blank ones of these sizes


def sized_pair(name: str, sizes: tuple[Size, Size]) -> SizedPair:
    """A pair of photographs of these sizes."""
    blank = [Image(np.broadcast_to(np.zeros(3, np.uint8), (height, width, 3))) for width, height in sizes]
    return SizedPair(name, sizes, (blank[0], blank[1]))


def of_box(values: object, what: str) -> Pieces:
    """The area of x0, y0, x1, y1; `InputError` where that is none."""
    box = numbers(values, (4,), f"{what}: a box is four numbers, x0, y0, x1, y1")
    if not (box[2] > box[0] and box[3] > box[1]):
        raise InputError(f"{what} is a box without area, {values}: x0 < x1 and y0 < y1 must hold")
    return [shapely.box(*box)]


def of_rings(rings: object, what: str) -> Pieces:
    """The area of an exterior ring and of holes, each a list of x, y; crossing rings are repaired."""
    if not isinstance(rings, list) or not rings:
        raise InputError(f"{what}: a polygon is a list of rings, the exterior first")
    each = [numbers(ring, (-1, 2), f"{what}: a ring is a list of x, y") for ring in rings]
    if any(len(ring) < 3 for ring in each):
        raise InputError(f"{what} has a ring of fewer than 3 points")
    shape = shapely.Polygon(each[0], each[1:])
    return _with_area(polygons_in(shape if shape.is_valid else shapely.make_valid(shape)), what)


def of_pixels(bits: NDArray[np.bool_], what: str, corner: tuple[int, int] = (0, 0)) -> Pieces:
    """The area of the pixels of a (h, w) mask whose first one is column and row `corner` of the image."""
    return _with_area(trace(bits, *corner), what)


def scaled(pieces: Pieces, size: Size, to: Size) -> Pieces:
    """An area of an image of `size` in the same image of another size."""
    factor = np.array(to) / np.array(size)
    return pieces if size == to else [shapely.transform(piece, lambda xy: xy * factor) for piece in pieces]


def numbers(values: object, shape: tuple[int, ...], complaint: str) -> NDArray[np.float64]:
    """An array of finite numbers of that shape (-1: of any length); `InputError` for anything else."""
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    fits = found.ndim == len(shape) and all(n in (-1, m) for n, m in zip(shape, found.shape, strict=True))
    if not fits or not np.isfinite(found).all():
        raise InputError(complaint)
    return found


def as_result(found: AreaMatches, sizes: tuple[Size, Size]) -> MatchResult:
    """The matches as a result that can be scored: each match has areas of its own, so that one which is in several
    matches counts in each. Areas without a match follow."""
    sides = []
    for k, (width, height) in enumerate(sizes):
        areas = [(left, right)[k] for left, right, _ in found.matches] + list(found.others[k])
        sides.append(ImagePolygons(width, height, [_area(n, pieces) for n, pieces in enumerate(areas)]))
    matches = [
        PolygonMatch(left=k, right=k, confidence=score, cost=1 - score, dsf=0, stage="global")
        for k, (_, _, score) in enumerate(found.matches)
    ]
    return MatchResult(
        left=sides[0],
        right=sides[1],
        matches=matches,
        points=PointMatches.empty(),
        fundamental=NO_GEOMETRY,
        homography=NO_GEOMETRY,
        config={},
        timings={} if found.seconds is None else {"match": found.seconds},
    )


def _area(id: int, pieces: Pieces) -> Area:
    largest = max(pieces, key=lambda piece: piece.area)
    return Area(id, np.array(largest.exterior.coords)[:-1], pieces=tuple(pieces))


def _with_area(pieces: Pieces, what: str) -> Pieces:
    if not pieces:
        raise InputError(f"{what} has no area")
    return pieces
