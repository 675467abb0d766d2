"""Guided re-detection: the regions of one image are looked for in the other.

Most matches are lost because the two images are segmented differently. The homologous points say where a polygon of one
image should be in the other (`polygons.warp`). There the segmenter is prompted with a point and the box of the warped
polygon. A box pulls the mask towards itself, so a mask is accepted only if it overlaps the warped polygon; where there
are no points to confirm it, prompting the first image with the mask must also lead back to the polygon.

Agreement between the images replaces part of the evidence that a single image has to bring: masks below the usual
thresholds (`guided.min_predicted_iou`, `guided.min_stability`) take part, and become polygons if they are matched. The
second image starts from the masks that were found this way; its grid of prompts fills the rest.
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
from zpm2.guided.prior import GuidedPrior
from zpm2.model import PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons.nest import with_parents
from zpm2.polygons.vectorize import outlines
from zpm2.polygons.warp import warp_by_points
from zpm2.segment import automatic
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView
from zpm2.segment.suppression import boxes

Array = NDArray[np.float64]
Carrier = tuple[PointMatches, Array | Failed]  # homologous points and H, as `warp_by_points` takes them
MIN_VISIBLE = 0.5  # share of a carried polygon that must lie in the other image
MIN_PIXELS = 4  # of the decoder that it must cover
FEW_POINTS = 3  # inside a polygon, below which its carried shape needs the way back as evidence
MASKS = 32  # at the image's resolution at a time
MIN_RETURN = 0.5  # IoU of a polygon with the answer to its answer


@dataclass(frozen=True, eq=False)
class ViewRegions:
    """The regions of one view, as masks and as polygons; row k of all is one region."""

    view: PromptedView
    predictions: MaskPredictions
    polygons: list[Polygon]  # without parents; ids are rows
    confident: NDArray[np.bool_]  # (n,) good enough without the other image
    guided: NDArray[np.bool_]  # (n,) found by asking about a polygon of the other image

    def __len__(self) -> int:
        return len(self.polygons)


@dataclass(frozen=True, eq=False)
class ViewPair:
    """The regions of both images."""

    left: ViewRegions
    right: ViewRegions


@dataclass(frozen=True, eq=False)
class AcceptedMasks:
    """Masks that agree with the polygon they were prompted for; `predictions.prompt` is its row."""

    predictions: MaskPredictions
    overlap: Array  # (n,) IoU with the carried polygon, 0..1


def detect(
    views: tuple[PromptedView, PromptedView],
    initial: InitialGeometry,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
) -> ViewPair:
    """The left image by segment everything; the right one first by asking about what that found."""
    segment, doubtful = config.segment, _loose_thresholds(config)
    found = automatic.automatic_masks(views[0], segment, doubtful, progress=lambda share: progress(share / 2))
    left = _regions(views[0], found, config, 0)
    there = accepted_masks(views[1], left, initial.forward(), initial.backward(), config)
    known = automatic.distinct(there.predictions, there.overlap, segment, views[1])
    found = automatic.automatic_masks(views[1], segment, doubtful, known, lambda share: progress((1 + share) / 2))
    return ViewPair(left, _regions(views[1], found, config, len(known)))


def redetect(pair: ViewPair, matches: Sequence[PolygonMatch], initial: InitialGeometry, config: Config) -> ViewPair:
    """The regions with what asking the left image about the right polygons without a match adds to them.

    An answer that is one of the left regions adds nothing: that one is a candidate already, as it overlaps.
    """
    left, right = pair.left, pair.right
    matched = {match.right for match in matches}
    unmatched = np.array([k for k in range(len(right)) if k not in matched], np.int64)
    asked = dataclasses.replace(
        right, predictions=right.predictions[unmatched], polygons=[right.polygons[k] for k in unmatched]
    )
    here = accepted_masks(left.view, asked, initial.backward(), initial.forward(), config)
    n = len(left)
    rank = np.append(2 + np.arange(n, 0.0, -1.0), here.overlap)
    merged = automatic.distinct(
        MaskPredictions.join([left.predictions, here.predictions]), rank, config.segment, left.view
    )
    new = _regions(left.view, merged[np.arange(n, len(merged))], config, len(merged))
    both = ViewRegions(
        left.view,
        MaskPredictions.join([left.predictions, new.predictions]),
        left.polygons + [dataclasses.replace(p, id=n + p.id) for p in new.polygons],
        np.append(left.confident, new.confident),
        np.append(left.guided, new.guided),
    )
    return ViewPair(both, right)


def guided_prior(pair: ViewPair, polygons: PolygonArrays, initial: InitialGeometry, config: Config) -> GuidedPrior:
    """What the matcher is told about the pair; `polygons` are the left ones."""
    left, right = pair.left, pair.right
    warped = warp_by_points(polygons, *initial.forward(), config.local_match.gamma)
    return GuidedPrior(
        warped, (left.confident, right.confident), (left.guided, right.guided), config.guided.min_match_overlap
    )


def settle(
    pair: ViewPair, matches: Sequence[PolygonMatch]
) -> tuple[tuple[list[Polygon], list[Polygon]], list[PolygonMatch]]:
    """Left and right polygons without the doubtful ones that found no partner, with parents and ids from 0 on, and the
    matches by these ids."""
    kept, ids = [], []
    for regions, partners in ((pair.left, [m.left for m in matches]), (pair.right, [m.right for m in matches])):
        stays = regions.confident.copy()
        stays[partners] = True
        rows = np.flatnonzero(stays)
        kept.append(with_parents([dataclasses.replace(regions.polygons[row], id=k) for k, row in enumerate(rows)]))
        ids.append(np.cumsum(stays) - 1)
    renamed = [dataclasses.replace(m, left=int(ids[0][m.left]), right=int(ids[1][m.right])) for m in matches]
    return (kept[0], kept[1]), renamed


def accepted_masks(
    view: PromptedView, asked: ViewRegions, there: Carrier, back: Carrier, config: Config
) -> AcceptedMasks:
    """The best answer of `view` for each region of the other image, if one is good enough.

    `there` leads from the regions' image to the view's, `back` the other way. What lies outside of the image for the
    most part, or is smaller than a few pixels of the decoder, is not asked about.
    """
    warped = warp_by_points(PolygonArrays(asked.polygons), *there, config.local_match.gamma)
    cover = view.cover(warped.shapes)
    predictions = _ask(view, cover, warped.shapes, config)
    best, overlap = _best(predictions, cover)
    good = overlap >= config.guided.min_overlap
    best, overlap = best[good], overlap[good]
    few = warped.own[predictions.prompt[best]] < FEW_POINTS
    good = ~few
    good[few] = _returns(view, predictions[best[few]], asked, back, config) >= MIN_RETURN
    return AcceptedMasks(predictions[best[good]], overlap[good])


def prompts(cover: NDArray[np.bool_], mask_scale: float) -> Prompts:
    """For each (h, w) shape, none empty, the pixel deepest inside it (of equally deep ones the first, row by row) and
    its box."""
    points = np.zeros((len(cover), 3, 2))
    for k, (bits, (x0, y0, x1, y1)) in enumerate(zip(cover, boxes(cover), strict=True)):
        crop = np.pad(bits[y0:y1, x0:x1], 1).view(np.uint8)
        depth = cv2.distanceTransform(crop, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        squared = np.rint(depth**2)  # whole numbers; OpenCV's last bits depend on where the array lies in memory
        y, x = np.unravel_index(np.argmax(squared), depth.shape)
        points[k] = (x0 + x - 0.5, y0 + y - 0.5), (x0, y0), (x1, y1)
    return Prompts(points / mask_scale, np.array([INSIDE, CORNER, OTHER_CORNER]))


def _ask(view: PromptedView, cover: NDArray[np.bool_], shapes: NDArray[np.object_], config: Config) -> MaskPredictions:
    """What `view` answers to (n,) carried shapes of which it shows `cover` (n, h, w); `prompt` are their rows."""
    pixels = cover.sum((1, 2))
    rows = np.flatnonzero((pixels / view.mask_scale**2 >= MIN_VISIBLE * shapely.area(shapes)) & (pixels >= MIN_PIXELS))
    predictions = view.predict(prompts(cover[rows], view.mask_scale), _loose_thresholds(config))
    return dataclasses.replace(predictions, prompt=rows[predictions.prompt])


def _best(predictions: MaskPredictions, target: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Array]:
    """Of each prompt the answer that overlaps `target[prompt]` most, as its row, and the IoU."""
    bits, wanted = predictions.bits, target[predictions.prompt]
    overlap = (bits & wanted).sum((1, 2)) / np.maximum((bits | wanted).sum((1, 2)), 1)
    order = np.lexsort((-overlap, predictions.prompt))
    _, first = np.unique(predictions.prompt[order], return_index=True)
    return order[first], overlap[order[first]]


def _returns(
    view: PromptedView, predictions: MaskPredictions, asked: ViewRegions, back: Carrier, config: Config
) -> Array:
    """(n,) the round trip: IoU of the region asked about with what its own image answers about the carried answer."""
    result = np.zeros(len(predictions))
    polygons, rows = _traced(view, predictions, config, 1.0)
    shapes = warp_by_points(PolygonArrays(polygons), *back, config.local_match.gamma).shapes
    home = _ask(asked.view, asked.view.cover(shapes), shapes, config)
    best, overlap = _best(home, asked.predictions[predictions.prompt[rows]].bits)
    result[rows[home.prompt[best]]] = overlap
    return result


def _regions(view: PromptedView, predictions: MaskPredictions, config: Config, guided: int) -> ViewRegions:
    """`predictions` as regions; the first `guided` were asked for."""
    segment = config.segment
    polygons, rows = _traced(view, predictions, config, segment.min_area)
    confident = predictions[rows].passing(MaskThresholds(segment.min_predicted_iou, segment.min_stability))
    return ViewRegions(view, predictions[rows], polygons, confident, rows < guided)


def _traced(
    view: PromptedView, predictions: MaskPredictions, config: Config, min_area: float
) -> tuple[list[Polygon], NDArray[np.int64]]:
    """The outlines of `predictions`, and the row of each. A few masks at a time: one may be as large as the image."""
    polygons: list[Polygon] = []
    rows, size = [np.zeros(0, np.int64)], (view.image.width, view.image.height)
    for start in range(0, len(predictions), MASKS):
        part = np.arange(start, min(start + MASKS, len(predictions)))
        found, of = outlines(view.masks(predictions[part]), config.vectorize, min_area, size)
        polygons += [dataclasses.replace(polygon, id=len(polygons) + polygon.id) for polygon in found]
        rows.append(part[of])
    return polygons, np.concatenate(rows)


def _loose_thresholds(config: Config) -> MaskThresholds:
    """The thresholds of regions that the other image must confirm: nowhere above those of segment everything."""
    segment, guided = config.segment, config.guided
    return MaskThresholds(
        min(guided.min_predicted_iou, segment.min_predicted_iou), min(guided.min_stability, segment.min_stability)
    )
