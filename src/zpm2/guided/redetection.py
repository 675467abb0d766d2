"""Guided re-detection: each polygon of one image is warped into the other and becomes a prompt there.

Most matches are lost because the two images are segmented differently. The homologous points warp a polygon of one
image into the other (`polygons.warp`), where a point in it and its box prompt the segmenter. A box pulls the mask
towards itself, so a mask is accepted only if it overlaps the warped polygon. If few points confirm it, or it overlaps
less, the way back is checked, too: the mask, warped back, must predict a mask of the first image that overlaps the
polygon. Where one point finds no such mask, several are tried. What a border cuts off is left out of the comparison.

Two images are more evidence than one, so masks below the usual thresholds take part (`guided.min_predicted_iou`,
`guided.min_stability`); they become polygons only if they are matched. After these prompts, segment everything
completes the second image.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config, SegmentConfig, VectorizeConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.guided.prior import GuidedPrior
from zpm2.model import PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.polygons.nest import with_parents
from zpm2.polygons.vectorize import outlines
from zpm2.polygons.visible import touched, within_borders
from zpm2.polygons.warp import WarpedPolygons, warp_by_points
from zpm2.segment import automatic, stacks
from zpm2.segment.inner_points import inner_points
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView
from zpm2.segment.stacks import BitStack, boxes

Array = NDArray[np.float64]
PointsAndH = tuple[PointMatches, Array | Failed]  # as `InitialGeometry.forward` and `backward` return them
MASK_CHUNK = 32  # masks at the image's resolution at a time


@dataclass(frozen=True, eq=False)
class Regions:
    """The regions of one image; row k of all is one region."""

    polygons: list[Polygon]  # without parents; ids are rows
    confident: NDArray[np.bool_]  # (n,) passed `segment`'s thresholds
    guided: NDArray[np.bool_]  # (n,) found by prompting with a polygon of the other image
    closer: NDArray[np.bool_]  # (n,) found by a closer look (`detail`)

    def __len__(self) -> int:
        return len(self.polygons)


@dataclass(frozen=True, eq=False)
class ViewRegions(Regions):
    """The regions of one view, as polygons and as masks."""

    view: PromptedView
    predictions: MaskPredictions


@dataclass(frozen=True, eq=False)
class DetectedPair:
    """The regions of both images, of a segmenter that takes prompts."""

    left: Regions
    right: Regions


@dataclass(frozen=True, eq=False)
class PromptedPair(DetectedPair):
    """The regions of both images, each seen in one view."""

    left: ViewRegions
    right: ViewRegions


@dataclass(frozen=True, eq=False)
class AcceptedMasks:
    """Masks that agree with the polygon they were prompted for; `predictions.prompt` is its row."""

    predictions: MaskPredictions
    overlap: Array  # (n,) IoU with the warped polygon, 0..1


def everything(view: PromptedView, config: Config, progress: Callable[[float], None] = lambda _: None) -> ViewRegions:
    """Segments everything in a left image, alone."""
    segment = _with_blobs(config.segment, config.guided.left_blobs)
    found = automatic.automatic_masks(view, segment, loose_thresholds(config), progress=progress)
    return view_regions(view, found, config, 0)


def detect(
    views: tuple[PromptedView, PromptedView],
    initial: InitialGeometry,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
    left: ViewRegions | None = None,
) -> PromptedPair:
    """Segments everything in the left image, prompts the right image with its polygons, and segments the rest there.
    `left` is everything in the left image, where that is known."""
    segment, loose = config.segment, loose_thresholds(config)
    if left is None:
        left = everything(views[0], config, lambda share: progress(share / 2))
    accepted = accepted_masks(views[1], left, initial.forward(), initial.backward(), config)
    known = automatic.without_duplicates([accepted.predictions], accepted.overlap, segment, views[1])
    segment = _with_blobs(segment, config.guided.right_blobs)
    found = automatic.automatic_masks(views[1], segment, loose, known, lambda share: progress((1 + share) / 2))
    return PromptedPair(left, view_regions(views[1], found, config, len(known)))


def _with_blobs(segment: SegmentConfig, times: float) -> SegmentConfig:
    """With so many times the prompts at blobs."""
    prompts = segment.prompts
    fast, balanced = (min(1.0, times * share) for share in (prompts.fast_blobs, prompts.balanced_blobs))
    return dataclasses.replace(segment, prompts=dataclasses.replace(prompts, fast_blobs=fast, balanced_blobs=balanced))


def redetect(
    pair: PromptedPair, matches: Sequence[PolygonMatch], initial: InitialGeometry, config: Config
) -> PromptedPair:
    """Prompts the left image with the unmatched right polygons, and adds the regions that this finds.

    A mask that shows a known left region is left out: that region overlaps the prompt, so it is already a candidate.
    """
    left, right = pair.left, pair.right
    matched = {match.right for match in matches}
    unmatched = np.array([k for k in range(len(right)) if k not in matched], np.int64)
    prompting = dataclasses.replace(
        right, predictions=right.predictions[unmatched], polygons=[right.polygons[k] for k in unmatched]
    )
    accepted = accepted_masks(left.view, prompting, initial.backward(), initial.forward(), config)
    n = len(left)
    rank = np.append(2 + np.arange(n, 0.0, -1.0), accepted.overlap)
    merged = automatic.without_duplicates([left.predictions, accepted.predictions], rank, config.segment, left.view)
    new = view_regions(left.view, merged[np.arange(n, len(merged))], config, len(merged))
    both = ViewRegions(
        left.polygons + [dataclasses.replace(p, id=n + p.id) for p in new.polygons],
        np.append(left.confident, new.confident),
        np.append(left.guided, new.guided),
        np.append(left.closer, new.closer),
        left.view,
        MaskPredictions.join([left.predictions, new.predictions]),
    )
    return PromptedPair(both, right)


def guided_prior(pair: DetectedPair, polygons: PolygonArrays, initial: InitialGeometry, config: Config) -> GuidedPrior:
    """What the matcher needs to know about the pair; `polygons` are the left ones."""
    left, right = pair.left, pair.right
    warped = warp_by_points(polygons, *initial.forward(), config.local_match)
    confident, guided = (left.confident, right.confident), (left.guided, right.guided)
    closer = left.closer, right.closer
    return GuidedPrior(warped, confident, guided, config.guided, closer, config.segment.detail)


def drop_unconfirmed(
    pair: DetectedPair, matches: Sequence[PolygonMatch], config: VectorizeConfig
) -> tuple[tuple[list[Polygon], list[Polygon]], list[PolygonMatch]]:
    """Left and right polygons that are confident or matched, with parents and with ids from 0 on, and the matches by
    these ids."""
    kept, ids = [], []
    for regions, partners in ((pair.left, [m.left for m in matches]), (pair.right, [m.right for m in matches])):
        confirmed = regions.confident.copy()
        confirmed[partners] = True
        polygons = [dataclasses.replace(regions.polygons[row], id=k) for k, row in enumerate(np.flatnonzero(confirmed))]
        kept.append(with_parents(polygons, config))
        ids.append(np.cumsum(confirmed) - 1)
    renamed = [dataclasses.replace(m, left=int(ids[0][m.left]), right=int(ids[1][m.right])) for m in matches]
    return (kept[0], kept[1]), renamed


def accepted_masks(
    view: PromptedView,
    regions: ViewRegions,
    there: PointsAndH,
    back: PointsAndH,
    config: Config,
    own_points: int = 0,
) -> AcceptedMasks:
    """For each of the other image's `regions`, the mask in `view` that overlaps it most, if it is good enough.

    `there` maps from the regions' image to the view's, `back` the other way. Regions of which the view shows
    too little, or only a few pixels of a decoded mask, are no prompts (`config.guided`), nor are those that
    hold fewer than `own_points` homologous points.
    """
    limits = config.guided
    polygons = PolygonArrays(regions.polygons)
    warped = warp_by_points(polygons, *there, config.local_match)
    cover = view.cover(warped.shapes)
    target = _Target.of(cover, _shown(view, polygons, warped, regions.view, config))
    rows = _prompting(view, cover, warped.shapes, config)
    rows = rows[warped.own[rows] >= own_points]
    found = []
    for points in sorted({1, limits.points}):  # first the cheap question, which most regions answer
        predictions = _predict_in(view, cover, rows, points, config)
        best, overlap = _best(predictions, target)
        good = overlap >= min(limits.min_checked_overlap, limits.min_overlap)
        best, overlap = best[good], overlap[good]
        few, loose = warped.own[predictions.prompt[best]] < limits.min_points, overlap < limits.min_overlap
        good, doubtful = ~(few | loose), few ^ loose  # both doubts together are too many
        returned = _return_overlap(view, predictions[best[doubtful]], regions, back, config)
        good[doubtful] = returned >= limits.min_return_overlap
        found.append(AcceptedMasks(predictions[best[good]], overlap[good]))
        rows = np.setdiff1d(rows, found[-1].predictions.prompt)
    return AcceptedMasks(
        MaskPredictions.join([f.predictions for f in found]), np.concatenate([f.overlap for f in found])
    )


def prompts(cover: NDArray[np.bool_], mask_scale: float, points: int = 1) -> Prompts:
    """For each shape of `cover` (n, h, w), none empty: its box and `points` pixels inside (`inner_points`), the last
    one again where there are fewer."""
    found = np.zeros((len(cover), points + 2, 2))
    for k, (bits, (x0, y0, x1, y1)) in enumerate(zip(cover, boxes(cover), strict=True)):
        inner = inner_points(bits[y0:y1, x0:x1], points) + np.array([x0, y0])
        found[k, :points] = inner[np.minimum(np.arange(points), len(inner) - 1)]
        found[k, points:] = (x0, y0), (x1, y1)
    return Prompts(found / mask_scale, np.array([INSIDE] * points + [CORNER, OTHER_CORNER]))


def _prompting(
    view: PromptedView, cover: NDArray[np.bool_], shapes: NDArray[np.object_], config: Config
) -> NDArray[np.intp]:
    """The rows of (n,) warped shapes that `view` shows well enough to be asked for; they cover its pixels `cover`."""
    pixels = stacks.counts(cover)
    visible = pixels / view.mask_scale**2 >= config.guided.min_visible * shapely.area(shapes)
    return np.flatnonzero(visible & (pixels >= config.guided.min_pixels))


def _predict_in(
    view: PromptedView, cover: NDArray[np.bool_], rows: NDArray[np.intp], points: int, config: Config
) -> MaskPredictions:
    """The masks in `view` for the shapes `rows` of `cover` (n, h, w), by so many points each; `prompt` are rows."""
    predictions = view.predict(prompts(cover[rows], view.mask_scale, points), loose_thresholds(config))
    return dataclasses.replace(predictions, prompt=rows[predictions.prompt])


@dataclass(frozen=True, eq=False)
class _Shown:
    """The pixels of a view that the photograph of another one can show, too: all of them, but for some shapes."""

    rows: NDArray[np.intp]  # (k,) of the shapes that are cut off
    bits: NDArray[np.bool_]  # (k, h, w) what is left


@dataclass(frozen=True, eq=False)
class _Target:
    """What n shapes cover of the pixels of a view that both photographs can show."""

    bits: BitStack  # (n, h, w)
    area: NDArray[np.int64]  # (n,) px^2
    shown: _Shown

    @staticmethod
    def of(bits: BitStack, shown: _Shown) -> "_Target":
        if len(shown.rows):
            bits = stacks.limited(bits, shown.rows, shown.bits)
        return _Target(bits, stacks.counts(bits), shown)


def _best(predictions: MaskPredictions, target: _Target) -> tuple[NDArray[np.intp], Array]:
    """For each prompt, the row of the mask that overlaps its row of `target` most, and their IoU, both over the pixels
    that are shown."""
    prompt, bits, area = predictions.prompt, predictions.inside, predictions.extent.area.copy()
    cut = np.flatnonzero(np.isin(prompt, target.shown.rows))
    if len(cut):
        of = np.searchsorted(target.shown.rows, prompt[cut])
        area[cut] = stacks.shared(predictions[cut].inside, target.shown.bits, of)
    shared = stacks.shared(bits, target.bits, prompt)
    overlap = shared / np.maximum(area + target.area[prompt] - shared, 1)
    order = np.lexsort((-overlap, prompt))
    _, first = np.unique(prompt[order], return_index=True)
    return order[first], overlap[order[first]]


def _return_overlap(
    view: PromptedView, predictions: MaskPredictions, regions: ViewRegions, back: PointsAndH, config: Config
) -> Array:
    """(n,) the round trip: each prediction is warped back and prompts the region's own image.

    Returns the IoU of each region with the best mask predicted there.
    """
    result = np.zeros(len(predictions))
    polygons, rows = _traced(view, predictions, config, 1.0)
    arrays = PolygonArrays(polygons)
    warped = warp_by_points(arrays, *back, config.local_match)
    cover = regions.view.cover(warped.shapes)
    asked = _prompting(regions.view, cover, warped.shapes, config)
    returned = _predict_in(regions.view, cover, asked, 1, config)
    wanted = regions.predictions[predictions.prompt[rows]].inside
    best, overlap = _best(returned, _Target.of(wanted, _shown(regions.view, arrays, warped, view, config)))
    result[rows[returned.prompt[best]]] = overlap
    return result


def _shown(
    view: PromptedView, polygons: PolygonArrays, warped: WarpedPolygons, own: PromptedView, config: Config
) -> _Shown:
    """What `view` and the photograph of the view `own` both show, where borders of the latter cut off one of its
    `polygons`, `warped` into `view` by enough points (`polygons.visible`)."""
    limits, size = config.local_match.visible, (own.image.width, own.image.height)
    sides = touched(polygons.shapes, size, limits.border)
    rows = np.flatnonzero(sides.any(1) & (warped.own >= limits.min_points) & limits.on)
    whole = np.full(len(rows), shapely.box(0, 0, view.image.width, view.image.height), object)
    parts = within_borders(whole, warped.maps[rows], size, sides[rows], polygons.centers[rows]) if len(rows) else whole
    return _Shown(rows, view.cover(parts))


def view_regions(view: PromptedView, predictions: MaskPredictions, config: Config, guided: int) -> ViewRegions:
    """`predictions` as regions; the first `guided` of them were found by prompting with the other image's."""
    segment = config.segment
    polygons, rows = _traced(view, predictions, config, segment.min_area)
    confident = predictions[rows].passing(MaskThresholds(segment.min_predicted_iou, segment.min_stability))
    return ViewRegions(polygons, confident, rows < guided, np.zeros(len(rows), bool), view, predictions[rows])


def _traced(
    view: PromptedView, predictions: MaskPredictions, config: Config, min_area: float
) -> tuple[list[Polygon], NDArray[np.int64]]:
    """The outlines of `predictions`, and the row of each. In chunks, as a mask may be as large as the image."""
    polygons: list[Polygon] = []
    rows, size = [np.zeros(0, np.int64)], (view.image.width, view.image.height)
    for start in range(0, len(predictions), MASK_CHUNK):
        part = np.arange(start, min(start + MASK_CHUNK, len(predictions)))
        found, of = outlines(view.masks(predictions[part]), config.vectorize, min_area, size)
        polygons += [dataclasses.replace(polygon, id=len(polygons) + polygon.id) for polygon in found]
        rows.append(part[of])
    return polygons, np.concatenate(rows)


def loose_thresholds(config: Config) -> MaskThresholds:
    """The thresholds of masks that the other image must confirm: never above those of segment everything."""
    segment, guided = config.segment, config.guided
    return MaskThresholds(
        min(guided.min_predicted_iou, segment.min_predicted_iou), min(guided.min_stability, segment.min_stability)
    )
