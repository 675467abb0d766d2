"""Guided re-detection: ask the segmenter in one image about the polygons of the other.

Most matches are lost because the two images are segmented differently. Where a polygon of one image should be in the
other is known from the homologous points (`carry`); there, the segmenter is asked with a point and the box of the
carried shape. A box pulls an answer towards itself, so an answer is believed only if its outline agrees with the
carried one, and where there are no points to confirm it, only if the way back leads to the polygon that it came from.

The same agreement stands in for the thresholds that segment everything needs when it sees one image alone: masks that
the model doubts (`guided.min_predicted_iou`, `guided.min_stability`) are asked about too, and become polygons if they
are matched. The second image starts from what the first one brought, and its grid only fills what that leaves.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.guided.prior import Guidance
from zpm2.model import PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons.nest import with_parents
from zpm2.polygons.vectorize import outlines
from zpm2.polygons.warp import carry
from zpm2.segment import automatic
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, Answers, Floor, Prompts
from zpm2.segment.protocol import PromptedView
from zpm2.segment.suppression import boxes

Array = NDArray[np.float64]
Carrier = tuple[PointMatches, Array | Failed]  # homologous points and H, as `carry` takes them
MIN_VISIBLE = 0.5  # share of a carried polygon that must lie in the other image
MIN_PIXELS = 4  # of the decoder that it must cover
FEW_POINTS = 3  # inside a polygon, below which its carried shape needs the way back as evidence
MASKS = 32  # at the image's resolution at a time
MIN_RETURN = 0.5  # IoU of a polygon with the answer to its answer


@dataclass(frozen=True, eq=False)
class Regions:
    """The regions of one view, as masks and as polygons; row k of all is one region."""

    view: PromptedView
    answers: Answers
    polygons: list[Polygon]  # without parents; ids are rows
    sure: NDArray[np.bool_]  # (n,) good enough without the other image
    guided: NDArray[np.bool_]  # (n,) found by asking about a polygon of the other image

    def __len__(self) -> int:
        return len(self.polygons)


@dataclass(frozen=True, eq=False)
class Pair:
    """The regions of both images."""

    left: Regions
    right: Regions


@dataclass(frozen=True, eq=False)
class Proposals:
    """Answers that agree with what they were asked for. `answers.prompt` are rows of the carried polygons."""

    answers: Answers
    overlap: Array  # (n,) IoU with the carried polygon, 0..1


def detect(
    views: tuple[PromptedView, PromptedView],
    initial: InitialGeometry,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
) -> Pair:
    """The left image by segment everything; the right one first by asking about what that found."""
    segment, doubtful = config.segment, _doubtful(config)
    found = automatic.everything(views[0], segment, doubtful, progress=lambda share: progress(share / 2))
    left = _regions(views[0], found, config, 0)
    there = propose(views[1], left, initial.forward(), initial.backward(), config)
    known = automatic.distinct(there.answers, there.overlap, segment, views[1])
    found = automatic.everything(views[1], segment, doubtful, known, lambda share: progress((1 + share) / 2))
    return Pair(left, _regions(views[1], found, config, len(known)))


def redetect(pair: Pair, matches: Sequence[PolygonMatch], initial: InitialGeometry, config: Config) -> Pair:
    """The regions with what asking the left image about the right polygons without a match adds to them.

    An answer that is one of the left regions adds nothing: that one is a candidate already, as it overlaps.
    """
    left, right = pair.left, pair.right
    matched = {match.right for match in matches}
    lonely = np.array([k for k in range(len(right)) if k not in matched], np.int64)
    asked = dataclasses.replace(right, answers=right.answers[lonely], polygons=[right.polygons[k] for k in lonely])
    here = propose(left.view, asked, initial.backward(), initial.forward(), config)
    n = len(left)
    rank = np.append(2 + np.arange(n, 0.0, -1.0), here.overlap)
    merged = automatic.distinct(Answers.join([left.answers, here.answers]), rank, config.segment, left.view)
    new = _regions(left.view, merged[np.arange(n, len(merged))], config, len(merged))
    both = Regions(
        left.view,
        Answers.join([left.answers, new.answers]),
        left.polygons + [dataclasses.replace(p, id=n + p.id) for p in new.polygons],
        np.append(left.sure, new.sure),
        np.append(left.guided, new.guided),
    )
    return Pair(both, right)


def guidance(pair: Pair, polygons: PolygonArrays, initial: InitialGeometry, config: Config) -> Guidance:
    """What the matcher is told about the pair; `polygons` are the left ones."""
    left, right = pair.left, pair.right
    carried = carry(polygons, *initial.forward(), config.local_match.gamma)
    return Guidance(carried, (left.sure, right.sure), (left.guided, right.guided), config.guided.min_match_overlap)


def settle(
    pair: Pair, matches: Sequence[PolygonMatch]
) -> tuple[tuple[list[Polygon], list[Polygon]], list[PolygonMatch]]:
    """Left and right polygons without the doubtful ones that found no partner, with parents and ids from 0 on, and the
    matches by these ids."""
    kept, ids = [], []
    for regions, partners in ((pair.left, [m.left for m in matches]), (pair.right, [m.right for m in matches])):
        stays = regions.sure.copy()
        stays[partners] = True
        rows = np.flatnonzero(stays)
        kept.append(with_parents([dataclasses.replace(regions.polygons[row], id=k) for k, row in enumerate(rows)]))
        ids.append(np.cumsum(stays) - 1)
    renamed = [dataclasses.replace(m, left=int(ids[0][m.left]), right=int(ids[1][m.right])) for m in matches]
    return (kept[0], kept[1]), renamed


def propose(view: PromptedView, asked: Regions, there: Carrier, back: Carrier, config: Config) -> Proposals:
    """The best answer of `view` for each region of the other image, if one is good enough.

    `there` leads from the regions' image to the view's, `back` the other way. What lies outside of the image for the
    most part, or is smaller than a few pixels of the decoder, is not asked about.
    """
    carried = carry(PolygonArrays(asked.polygons), *there, config.local_match.gamma)
    cover = view.cover(carried.shapes)
    answers = _ask(view, cover, carried.shapes, config)
    best, overlap = _best(answers, cover)
    good = overlap >= config.guided.min_overlap
    best, overlap = best[good], overlap[good]
    few = carried.own[answers.prompt[best]] < FEW_POINTS
    good = ~few
    good[few] = _returns(view, answers[best[few]], asked, back, config) >= MIN_RETURN
    return Proposals(answers[best[good]], overlap[good])


def prompts(cover: NDArray[np.bool_], low: float) -> Prompts:
    """For each (h, w) shape, none empty, the pixel deepest inside it (of equally deep ones the first, row by row) and
    its box."""
    points = np.zeros((len(cover), 3, 2))
    for k, (bits, (x0, y0, x1, y1)) in enumerate(zip(cover, boxes(cover), strict=True)):
        crop = np.pad(bits[y0:y1, x0:x1], 1).view(np.uint8)
        depth = cv2.distanceTransform(crop, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        squared = np.rint(depth**2)  # whole numbers; OpenCV's last bits depend on where the array lies in memory
        y, x = np.unravel_index(np.argmax(squared), depth.shape)
        points[k] = (x0 + x - 0.5, y0 + y - 0.5), (x0, y0), (x1, y1)
    return Prompts(points / low, np.array([INSIDE, CORNER, OTHER_CORNER]))


def _ask(view: PromptedView, cover: NDArray[np.bool_], shapes: NDArray[np.object_], config: Config) -> Answers:
    """What `view` answers to (n,) carried shapes of which it shows `cover` (n, h, w); `prompt` are their rows."""
    pixels = cover.sum((1, 2))
    rows = np.flatnonzero((pixels / view.low**2 >= MIN_VISIBLE * shapely.area(shapes)) & (pixels >= MIN_PIXELS))
    answers = view.ask(prompts(cover[rows], view.low), _doubtful(config))
    return dataclasses.replace(answers, prompt=rows[answers.prompt])


def _best(answers: Answers, target: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Array]:
    """Of each prompt the answer that overlaps `target[prompt]` most, as its row, and the IoU."""
    bits, wanted = answers.bits, target[answers.prompt]
    overlap = (bits & wanted).sum((1, 2)) / np.maximum((bits | wanted).sum((1, 2)), 1)
    order = np.lexsort((-overlap, answers.prompt))
    _, first = np.unique(answers.prompt[order], return_index=True)
    return order[first], overlap[order[first]]


def _returns(view: PromptedView, answers: Answers, asked: Regions, back: Carrier, config: Config) -> Array:
    """(n,) the round trip: IoU of the region asked about with what its own image answers about the carried answer."""
    result = np.zeros(len(answers))
    polygons, rows = _traced(view, answers, config, 1.0)
    shapes = carry(PolygonArrays(polygons), *back, config.local_match.gamma).shapes
    home = _ask(asked.view, asked.view.cover(shapes), shapes, config)
    best, overlap = _best(home, asked.answers[answers.prompt[rows]].bits)
    result[rows[home.prompt[best]]] = overlap
    return result


def _regions(view: PromptedView, answers: Answers, config: Config, guided: int) -> Regions:
    """`answers` as regions; the first `guided` were asked for."""
    segment = config.segment
    polygons, rows = _traced(view, answers, config, segment.min_area)
    sure = answers[rows].reach(Floor(segment.min_predicted_iou, segment.min_stability))
    return Regions(view, answers[rows], polygons, sure, rows < guided)


def _traced(
    view: PromptedView, answers: Answers, config: Config, min_area: float
) -> tuple[list[Polygon], NDArray[np.int64]]:
    """The outlines of `answers`, and the row of each; a few masks at a time, as one may be as large as the image."""
    polygons: list[Polygon] = []
    rows, size = [np.zeros(0, np.int64)], (view.image.width, view.image.height)
    for start in range(0, len(answers), MASKS):
        part = np.arange(start, min(start + MASKS, len(answers)))
        found, of = outlines(view.masks(answers[part]), config.vectorize, min_area, size)
        polygons += [dataclasses.replace(polygon, id=len(polygons) + polygon.id) for polygon in found]
        rows.append(part[of])
    return polygons, np.concatenate(rows)


def _doubtful(config: Config) -> Floor:
    """The thresholds of regions that the other image must confirm: nowhere above those of segment everything."""
    segment, guided = config.segment, config.guided
    return Floor(
        min(guided.min_predicted_iou, segment.min_predicted_iou), min(guided.min_stability, segment.min_stability)
    )
