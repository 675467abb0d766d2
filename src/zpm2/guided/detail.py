"""Finer regions where they pay: both images are looked at again in windows of the part that both show (`windows`).

A window is one more view of each image, encoded at its full resolution. Regions that are known keep their prompts and
masks away. Prompts are made only where they may lead to a match: near homologous points, as its regions must share some
(`detail.min_points`), at what was too small for the whole view, and for each known region in one window only. What is
new is carried to the other image as in `redetection`. A window may hold a part of a region only, so masks that touch a
border of the window which is no border of the image are dropped, as in SAM's automatic mask generator (Kirillov et al.
2023, Appendix B). Only one window is encoded at a time.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config, SegmentConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.guided import windows
from zpm2.guided.redetection import (
    DetectedPair,
    PointsAndH,
    Regions,
    ViewRegions,
    accepted_masks,
    loose_thresholds,
    view_regions,
)
from zpm2.guided.windows import Box, WindowPair
from zpm2.model import Image, PointMatches, Polygon, PolygonMatch, shapes_of
from zpm2.segment import automatic, family
from zpm2.segment.inner_points import squared_depth
from zpm2.segment.predictions import MaskPredictions
from zpm2.segment.protocol import PromptedView

KNOWN, ASKED_FOR = -1, -2  # in place of the row of a prompt
LOGIT = 8.0  # of a pixel of a known region
Views = Callable[[Image, Image], tuple[PromptedView, PromptedView]]
Match = Callable[[DetectedPair], Sequence[PolygonMatch]]


def look_closer(
    pair: DetectedPair,
    images: tuple[Image, Image],
    views: Views,
    initial: InitialGeometry,
    matches: Sequence[PolygonMatch],
    match: Match,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
) -> DetectedPair:
    """`pair`, and the regions that windows show.

    `matches` are those of `pair`, and `match` finds those of a pair, by rows. `views` encodes a part of each image. On
    level auto nothing is done where the matched regions cover enough. That is more where scales differ: what one image
    shows large is likely to be missed in the other. The window with the most open blobs is next; a window that adds too
    few matches is the last one of its size.
    """
    detail, done = config.segment.detail, list[WindowPair]()
    high = detail.level == "high"
    most = detail.high_windows if high else detail.auto_windows
    part = windows.shared_part(images, initial, config)
    enough = detail.zoomed_coverage if part.zoom >= detail.zoom else detail.min_coverage
    if not high and part.covered(_matched(pair, matches)) >= enough:
        return pair
    for halving in windows.candidates(part, config):
        rest = list(halving)
        while rest and len(done) < most:
            blobs = windows.open_blobs(images[0], part, _matched(pair, matches), config)
            held = [int(windows.inside(blobs, window.left).sum()) for window in rest]
            if max(held) < detail.min_blobs:
                break
            window = rest.pop(int(np.argmax(held)))
            crops = _crop(images[0], window.left), _crop(images[1], window.right)
            looked = _Window(images, window, views(*crops), initial, part, config, tuple(done))
            pair = _in_window(pair, matches, looked)
            done.append(window)
            before, matches = len(matches), match(pair)
            progress(len(done) / most)
            if len(matches) - before < detail.min_new:
                break
    return pair


@dataclass(frozen=True, eq=False)
class _Window:
    """A window of both images, encoded."""

    images: tuple[Image, Image]
    boxes: WindowPair
    views: tuple[PromptedView, PromptedView]
    initial: InitialGeometry
    part: windows.SharedPart
    config: Config
    earlier: tuple[WindowPair, ...]  # those that were looked at before it

    def shown(self) -> NDArray[np.bool_]:
        """(height, width) of a decoded mask of the left window: what the right image shows."""
        cells = shapely.transform(self.part.cells, lambda xy: xy - self.boxes.left[:2])
        return np.asarray(self.views[0].cover(cells).any(0))

    def points(self, k: int) -> NDArray[np.bool_]:
        """(height, width) of a decoded mask of window k: the pixels with homologous points. What holds none of them
        is not matched."""
        view, points = self.views[k], self.initial.forward()[0]
        result = np.full(view.size, self.config.segment.detail.min_points == 0)
        at = np.floor(((points.left, points.right)[k] - self.boxes[k][:2]) * view.mask_scale).astype(np.int64)
        column, row = at[((at >= 0) & (at < view.size[::-1])).all(1)].T
        result[row, column] = True
        return result

    def segment(self, k: int) -> SegmentConfig:
        """How window k is prompted: as densely on the image as the whole view, and at blobs that were too small
        there."""
        segment, box = self.config.segment, self.boxes[k]
        scale = max(box[2] - box[0], box[3] - box[1]) / max(self.images[k].width, self.images[k].height)
        sigmas = segment.prompts.blob_sigmas
        small = tuple(sigma for sigma in sigmas if sigma * scale <= min(sigmas))
        return dataclasses.replace(
            segment, grid=segment.detail.grid, prompts=dataclasses.replace(segment.prompts, blob_sigmas=small)
        )

    def regions(self, k: int, known: MaskPredictions, where: NDArray[np.bool_] | None) -> ViewRegions:
        """Everything in image k but what is KNOWN, first what was ASKED_FOR, and the families of all these, at the
        pixels `where`, near homologous points."""
        view, loose, points = self.views[k], loose_thresholds(self.config), self.points(k)
        near = within(self.config.segment.detail.reach, points)
        at = near if where is None else near & where
        found = automatic.automatic_masks(view, self.segment(k), loose, known, where=at)
        found = family.with_families(view, found, self.segment(k), loose, where, points)
        new = self.uncut(k, found[found.prompt != KNOWN])
        return view_regions(view, new, self.config, int((new.prompt == ASKED_FOR).sum()))

    def asked_for(self, k: int, regions: ViewRegions) -> MaskPredictions:
        """Masks in image k that show `regions` of the other one, marked so; the one that fits best first."""
        there = moved(self.initial.forward(), self.boxes.left, self.boxes.right)
        back = moved(self.initial.backward(), self.boxes.right, self.boxes.left)
        there, back = (there, back) if k else (back, there)
        config, least = self.config, self.config.segment.detail.min_points
        if k == 0:  # where one point finds no mask on the way back, several hardly do
            config = dataclasses.replace(config, guided=dataclasses.replace(config.guided, points=1))
        accepted = accepted_masks(self.views[k], regions, there, back, config, least)
        rows = np.arange(len(accepted.predictions))
        whole = self.uncut(k, dataclasses.replace(accepted.predictions, prompt=rows))
        marked = dataclasses.replace(whole, prompt=np.full(len(whole), ASKED_FOR))
        return automatic.without_duplicates([marked], accepted.overlap[whole.prompt], self.segment(k), self.views[k])

    def beside(self, k: int, known: Sequence[MaskPredictions], asked: MaskPredictions) -> ViewRegions:
        """Those of the masks `asked` for in image k, best first, that are no known regions."""
        marked = [dataclasses.replace(each, prompt=np.full(len(each), KNOWN)) for each in known]
        rank = np.arange(len(asked) + sum(map(len, known)), 0.0, -1.0)
        kept = automatic.without_duplicates([*marked, asked], rank, self.segment(k), self.views[k])
        new = kept[kept.prompt != KNOWN]
        return view_regions(self.views[k], new, self.config, len(new))

    def uncut(self, k: int, predictions: MaskPredictions) -> MaskPredictions:
        """Without masks of image k that touch a border of the window which is no border of the image."""
        box, size = self.boxes[k], (self.images[k].width, self.images[k].height)
        view, bounds = self.views[k], predictions.extent.box
        inner = np.array([box[0] > 0, box[1] > 0, box[2] < size[0], box[3] < size[1]])
        height, width = view.size
        touches = np.c_[bounds[:, :2] <= 0, bounds[:, 2:] >= [width, height]]
        return predictions[~(touches & inner).any(1)]


def _in_window(pair: DetectedPair, matches: Sequence[PolygonMatch], window: _Window) -> DetectedPair:
    """`pair`, and what the window shows beyond it."""
    left = _Known.of(pair.left, [m.left for m in matches], window, 0)
    right = _Known.of(pair.right, [m.right for m in matches], window, 1)
    new_left = window.regions(0, left.masks, window.shown())
    asked = window.asked_for(1, _both(left.alone, new_left))
    new_right = window.regions(1, MaskPredictions.join([right.masks, asked]), None)
    found = [new_left]
    if window.config.guided.direction == "both":
        asked = window.asked_for(0, _both(right.alone, _rows(new_right, ~new_right.guided)))
        found.append(window.beside(0, [left.masks, new_left.predictions], asked))
    return DetectedPair(
        _joined(pair.left, found, window.boxes.left), _joined(pair.right, [new_right], window.boxes.right)
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """The known regions of one image in a window."""

    masks: MaskPredictions  # of all that the window shows; their prompt is KNOWN
    alone: ViewRegions  # the unmatched ones that lie wholly in the window, and that no window asked for; px of it

    @staticmethod
    def of(regions: Regions, matched: Sequence[int], window: _Window, k: int) -> "_Known":
        """`matched` are rows of the `regions` of image k."""
        view, box = window.views[k], window.boxes[k]
        frame, free = shapely.box(*box), ~regions.closer
        free[list(matched)] = False
        shapes = shapes_of(regions.polygons)
        for earlier in window.earlier:
            free &= ~shapely.within(shapes, shapely.box(*earlier[k]))
        rows = shapely.STRtree(shapes).query(frame, predicate="intersects")
        rows = np.sort(rows)
        cover = view.cover(shapely.transform(shapes[rows], lambda xy: xy - box[:2]))
        shown = cover.any((1, 2))
        rows, cover = rows[shown], cover[shown]
        n = len(rows)
        logits = np.where(cover, np.float16(LOGIT), np.float16(-LOGIT))
        masks = MaskPredictions(np.full(n, KNOWN), np.ones(n, np.float32), np.ones(n, np.float32), logits)
        polygons = [_shifted(regions.polygons[row], k, -np.array(box[:2])) for k, row in enumerate(rows)]
        flags = regions.confident[rows], regions.guided[rows], regions.closer[rows]
        every = ViewRegions(polygons, *flags, view, masks)
        return _Known(masks, _rows(every, free[rows] & shapely.within(shapes[rows], frame)))


def moved(points_and_h: PointsAndH, here: Box, there: Box) -> PointsAndH:
    """Points and H between two images as between a box of either."""
    points, h = points_and_h
    shifted = PointMatches(points.left - here[:2], points.right - there[:2], points.score)
    if isinstance(h, Failed):
        return shifted, h
    return shifted, translation(-there[0], -there[1]) @ h @ translation(*here[:2])


def within(reach: float, pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(height, width) what is at most so many px from one of the `pixels`."""
    if not pixels.any():
        return pixels
    return np.asarray(squared_depth(~pixels) <= reach**2)


def _matched(pair: DetectedPair, matches: Sequence[PolygonMatch]) -> NDArray[np.object_]:
    """The matched left polygons."""
    return shapes_of([pair.left.polygons[match.left] for match in matches])


def _crop(image: Image, box: Box) -> Image:
    """The part of an image in a box."""
    part = np.s_[box[1] : box[3], box[0] : box[2]]
    valid = None if image.valid is None else image.valid[part]
    return Image(np.ascontiguousarray(image.rgb[part]), image.path, (), valid)


def _rows(regions: ViewRegions, wanted: NDArray[np.bool_]) -> ViewRegions:
    polygons = [regions.polygons[row] for row in np.flatnonzero(wanted)]
    flags = regions.confident[wanted], regions.guided[wanted], regions.closer[wanted]
    return ViewRegions(polygons, *flags, regions.view, regions.predictions[wanted])


def _both(first: ViewRegions, second: ViewRegions) -> ViewRegions:
    return ViewRegions(
        first.polygons + second.polygons,
        np.append(first.confident, second.confident),
        np.append(first.guided, second.guided),
        np.append(first.closer, second.closer),
        first.view,
        MaskPredictions.join([first.predictions, second.predictions]),
    )


def _joined(regions: Regions, new: Sequence[Regions], box: Box) -> Regions:
    """`regions`, and new ones found in a box, px of that. None of these is confident: what is small is off by much of
    its size if the points around it are off by a few px, so points in it must confirm its match."""
    polygons = list(regions.polygons)
    for each in new:
        polygons += [_shifted(polygon, len(polygons) + k, np.array(box[:2])) for k, polygon in enumerate(each.polygons)]
    confident = np.append(regions.confident, np.zeros(len(polygons) - len(regions), bool))
    guided = np.concatenate([regions.guided, *(each.guided for each in new)])
    closer = np.append(regions.closer, np.ones(len(polygons) - len(regions), bool))
    return Regions(polygons, confident, guided, closer)


def _shifted(polygon: Polygon, id: int, shift: NDArray[np.int64]) -> Polygon:
    holes = tuple(hole + shift for hole in polygon.holes)
    return dataclasses.replace(polygon, id=id, exterior=polygon.exterior + shift, holes=holes)


def translation(x: float, y: float) -> NDArray[np.float64]:
    """(3, 3) the homography that moves points by (x, y) px."""
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
