"""Regions of one photograph in another, both small enough to be seen as a whole."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.carry import contest, outcome
from zpm2.carry.asking import Answers, Expectation, ask
from zpm2.carry.likeness import Cells, cells_of, transferred
from zpm2.carry.outcome import Outcome
from zpm2.carry.places import Places, places
from zpm2.carry.resemblance import resemblance
from zpm2.config import CarryConfig, Config
from zpm2.formats.regions.outlines import joined
from zpm2.formats.regions.region import Shape
from zpm2.global_match import InitialGeometry
from zpm2.model import Image
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.polygons.repair import polygons_in
from zpm2.polygons.simplify import simplify
from zpm2.polygons.trace import trace
from zpm2.polygons.vectorize import without_small_holes
from zpm2.segment.predictions import MaskPredictions
from zpm2.segment.protocol import EmbeddedView, PromptedSegmenter, PromptedView
from zpm2.segment.view_of import view_of

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]
ASKED = 16  # regions whose answers are in memory at the decoder's resolution before the best are chosen


def carry(
    images: tuple[Image, Image],
    shapes: Shapes,
    names: Sequence[str],
    initial: InitialGeometry,
    segmenter: PromptedSegmenter,
    config: Config,
    kept: KeptPhotos = NOTHING_KEPT,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Outcome]:
    """What became of each of (n,) shapes, left px. `names` are what reasons call them; `initial` is the pair's. A
    photograph that is `kept` is encoded once."""
    found = places(shapes, initial, config.carry, config.local_match)
    size = images[1].width, images[1].height
    asked = [
        k
        for k, (place, trust) in enumerate(zip(found.shapes, found.trust, strict=True))
        if not outcome.is_outside(place, trust, size, config.carry)
    ]
    if not asked:
        return [_outcome(found, k, None, size, config.carry) for k in range(len(shapes))]
    view = view_of(segmenter, images[1], kept)
    likeness = None
    if isinstance(view, EmbeddedView):
        other = view_of(segmenter, images[0], kept)
        assert isinstance(other, EmbeddedView)
        likeness = _Likeness(other, view, shapes, config.carry)
    answers = [Answers.none(view.size)] * len(shapes)
    resembles = resemblance(images, found, initial, config)
    trust, exact = resembles.trust(found, config.carry), resembles.exact(found, initial, config.carry)
    for start in range(0, len(asked), ASKED):
        rows = asked[start : start + ASKED]
        expected = [_expected(view, found.shapes[k], float(trust[k]), float(exact[k]), k, likeness) for k in rows]
        for k, each in zip(rows, ask(view, expected, config.carry), strict=True):
            answers[k] = each
        progress((start + len(rows)) / len(asked))
    choices = contest.decide(answers, shapes, config.carry)
    got = {k: choice.row for k, choice in enumerate(choices) if choice.row is not None}
    elsewhere = [k for k, row in got.items() if 2 * answers[k].by_place[row] < answers[k].agreement[row]]
    trust = np.maximum(trust, found.trust)  # something may be in front of it
    trust[elsewhere] = 0.0  # the likeness decided, against the points or without them
    found = replace(found, trust=trust)
    outlines = {
        k: _within(found.shapes[k], size)
        if answers[k].moved[row]
        else outline(view, answers[k].masks[np.array([row])], config)
        for k, row in got.items()
    }
    drawn = [k for k, each in outlines.items() if each is not None]
    agreement = np.array([answers[k].agreement[got[k]] for k in drawn])
    known = np.where(found.trust >= config.carry.min_trust, found.shapes, shapely.Polygon())[drawn]
    whole = np.array([outlines[k] for k in drawn], object)
    apart = contest.disjoint(whole, shapes[drawn], known, agreement, config.carry)
    shown: dict[int, Shape] = {k: shape for k, shape in zip(drawn, apart, strict=True) if not shape.is_empty}
    visible = _visible(found, shown, likeness, config.carry)
    results = []
    for k, (each, choice) in enumerate(zip(answers, choices, strict=True)):
        seen = None
        if k in shown:
            others = tuple(_center(view, each.masks.bits[row], each.agreement[row]) for row in choice.others)
            seen = _Seen(shown[k], float(each.agreement[got[k]]), visible[k], bool(each.moved[got[k]]), others)
        lost = None if choice.lost is None else names[choice.lost]
        results.append(_outcome(found, k, seen, size, config.carry, lost))
    return results


class _Likeness:
    """How alike cells of the right photograph and the regions are, and the other way round."""

    def __init__(self, left: EmbeddedView, right: EmbeddedView, shapes: Shapes, config: CarryConfig) -> None:
        scales = left.embedding_scale, right.embedding_scale
        self.config = config
        self.sides: tuple[Cells, Cells] = cells_of(left.embedding(), right.embedding(), scales)
        self.shares = self.sides[0].shares(shapes)
        self.pictures = transferred(*self.sides, self.shares, config)

    def weight(self, k: int) -> float:
        """0..1, how much the likeness of region k says: it must fill some cells."""
        return float(min(1.0, self.shares[k].sum() / self.config.cells))

    def picture(self, k: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """(h, w) of region k on the pixels of a decoded mask."""
        cells = self.pictures[k].astype(np.float32)
        px = -(-max(size) // max(cells.shape))
        fine = cv2.resize(cells, (cells.shape[1] * px, cells.shape[0] * px), interpolation=cv2.INTER_LINEAR)
        return np.asarray(fine[: size[0], : size[1]])

    def visible(self, rows: Sequence[int], shapes: Shapes) -> Array:
        """(k,) 0..1, the share of each of the regions `rows` that looks like something inside its found shape, right
        px."""
        back = transferred(self.sides[1], self.sides[0], self.sides[1].shares(shapes), self.config)
        return np.array([np.average(b.ravel() >= 0.5, weights=self.shares[k]) for k, b in zip(rows, back, strict=True)])


def _expected(
    view: PromptedView, place: Shape, trust: float, exact: float, k: int, likeness: _Likeness | None
) -> Expectation:
    cover = view.cover(np.array([place], object))[0]
    if likeness is None:
        return Expectation(cover, trust, exact, np.zeros(view.size, np.float32), 0.0)
    return Expectation(cover, trust, exact, likeness.picture(k, view.size), likeness.weight(k))


def outline(view: PromptedView, mask: MaskPredictions, config: Config) -> Shape | None:
    """The pieces of one mask at the image's resolution, px of the image, without specks and pinholes, simplified; None
    where nothing is left."""
    (fine,) = view.masks(mask)
    pieces = trace(fine.bits, fine.x0, fine.y0) if fine.bits.any() else []
    kept = [piece for piece in pieces if piece.area >= config.carry.min_part * pieces[0].area]
    holes = min(config.segment.min_area, config.carry.min_part * fine.area)
    simple = simplify([without_small_holes(piece, holes) for piece in kept], config.vectorize, 0.0)
    return shapely.unary_union(simple) if len(simple) else None


def _within(shape: Shape, size: tuple[int, int]) -> Shape | None:
    """The parts of a shape, px, inside a photograph of `size` (width, height) px."""
    return joined(polygons_in(shape.intersection(shapely.box(0, 0, *size))))


def _center(view: PromptedView, bits: NDArray[np.bool_], agreement: float) -> tuple[float, float, float]:
    """x, y, image px, and the agreement of a mask."""
    y, x = np.nonzero(bits)
    return float((x.mean() + 0.5) / view.mask_scale), float((y.mean() + 0.5) / view.mask_scale), float(agreement)


def _visible(
    found: Places, shown: dict[int, Shape], likeness: _Likeness | None, config: CarryConfig
) -> dict[int, float | None]:
    """How much of each region is visible, by its row: by its place where points tell it, else by its likeness."""
    visible: dict[int, float | None] = dict.fromkeys(shown)
    placed = [k for k in shown if found.trust[k] >= config.trusted and not found.shapes[k].is_empty]
    for k in placed:
        place = found.shapes[k]
        visible[k] = float(min(1.0, shown[k].intersection(place).area / place.area))
    rows = [] if likeness is None else [k for k in shown if k not in placed and likeness.weight(k) >= 1]
    if likeness is not None and rows:
        shares = likeness.visible(rows, np.array([shown[k] for k in rows], object))
        visible |= dict(zip(rows, shares.tolist(), strict=True))
    return visible


@dataclass(frozen=True, eq=False)
class _Seen:
    """The outline that a region got."""

    shape: Shape  # right px
    agreement: float
    visible: float | None
    moved: bool  # not by the segmenter
    others: tuple[tuple[float, float, float], ...] = ()  # x, y, agreement of answers elsewhere


def _outcome(
    found: Places, k: int, seen: _Seen | None, size: tuple[int, int], config: CarryConfig, lost: str | None = None
) -> Outcome:
    trust, place = float(found.trust[k]), found.shapes[k]
    known = trust >= config.min_trust and not place.is_empty
    sure = 0.0 if seen is None else _confidence(found, k, seen.agreement, config)
    others = () if seen is None else seen.others
    doubt = ""
    if seen is not None and sure < config.min_confidence:
        at = seen.shape.centroid
        others, doubt = ((float(at.x), float(at.y), seen.agreement), *others), f"; the best outline is {sure:.2f} sure"
        seen, sure = None, 0.0
    where = place if known else None if seen is None else seen.shape
    if seen is None:
        status, reason = outcome.missing(place, trust, size, lost, config)
        reason += doubt
    else:
        status, reason = outcome.found(seen.visible, place, trust, seen.moved, size, config)
    gone = 0.0 if status in ("outside", "hidden") else None
    return Outcome(
        status,
        reason,
        None if seen is None else seen.shape,
        sure,
        gone if seen is None else seen.visible,
        0.0 if seen is None else seen.agreement,
        trust,
        int(found.agreeing[k]),
        None if where is None else (float(where.centroid.x), float(where.centroid.y)),
        float(found.sigma[k]) if known and np.isfinite(found.sigma[k]) else None,
        others,
        found.pair_points,
        float(found.surrounded[k]),
    )


def _confidence(found: Places, k: int, agreement: float, config: CarryConfig) -> float:
    return outcome.confidence(agreement, float(found.trust[k]), found.pair_points, float(found.surrounded[k]), config)


def moved_only(
    size: tuple[int, int], shapes: Shapes, initial: InitialGeometry, config: Config, linear: Array | None
) -> list[Outcome]:
    """The shapes moved without change of form: by the similarity nearest to their map, or by `linear` (2, 2), that of
    two georeferences, and the shift that the points tell. `size` is the right photograph's (width, height) px; none is
    segmented."""
    found = places(shapes, initial, config.carry, config.local_match)
    results = []
    for k, shape in enumerate(shapes):
        trust, place = float(found.trust[k]), found.shapes[k]
        if place.is_empty or trust < config.carry.min_trust:
            results.append(_outcome(found, k, None, size, config.carry))
            continue
        here, there = np.array(shape.centroid.coords[0]), np.array(place.centroid.coords[0])
        turn = _similarity(found.maps[k], here) if linear is None else linear
        moved = shapely.transform(shape, lambda xy, turn=turn, here=here, there=there: (xy - here) @ turn.T + there)
        within = outcome.inside_share(moved, size)
        if within < config.carry.outside:
            results.append(_outcome(found, k, None, size, config.carry))
            continue
        results.append(_outcome(found, k, _Seen(moved, trust, within, True), size, config.carry))
    return results


def _similarity(matrix: Array, at: Array) -> Array:
    """(2, 2) the rotation and scale nearest to a map around a point."""
    linear = geometry.homography_jacobian(matrix, at[None])[0]
    a, b = (linear[0, 0] + linear[1, 1]) / 2, (linear[1, 0] - linear[0, 1]) / 2
    return np.array([[a, -b], [b, a]])
