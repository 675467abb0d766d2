"""A segmenter that can be asked and whose regions are known: shapes painted on a photograph."""

import dataclasses
from dataclasses import dataclass, field

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.model import Image, Mask
from zpm2.segment.mask_view import decoded_size, upsample
from zpm2.segment.predictions import CORNER, MASK_SIDE, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam_view import SamView


@dataclass(frozen=True)
class Region:
    """`score` and `stability` are the segmenter's; only a box around it finds a `prompt_only` one."""

    shape: shapely.Polygon  # image px
    score: float = 0.95
    stability: float = 0.97
    prompt_only: bool = False


@dataclass
class PaintedView:
    """Answers with the (up to three) smallest regions around the point; a box must fit by half."""

    image: Image
    regions: list[Region]
    batch: int = 16
    asked: list[tuple[float, float]] = field(default_factory=list)  # every point ever asked, image px

    def __post_init__(self) -> None:
        self.mask_scale = MASK_SIDE / max(self.image.width, self.image.height)
        self.size = decoded_size(self.image)
        self.bits = self.cover(np.array([region.shape for region in self.regions], object))

    cover = SamView.cover

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        found = []
        for k, points in enumerate(prompts.points):
            self.asked.append(tuple(points[0]))
            x, y = np.minimum((points[0] * self.mask_scale).astype(int), [self.size[1] - 1, self.size[0] - 1])
            box = shapely.box(*points[prompts.labels >= CORNER].ravel()) if len(points) > 1 else None
            around = [n for n in range(len(self.regions)) if self.bits[n, y, x] and self._answers(n, box)]
            for n in sorted(around, key=lambda n: self.bits[n].sum())[:3]:
                region = self.regions[n]
                if region.score >= thresholds.predicted_iou and region.stability >= thresholds.stability:
                    found.append((k, region.score, region.stability, self.bits[n]))
        if not found:
            return MaskPredictions.none(self.size)
        prompt, score, stability, bits = zip(*found, strict=True)
        logits = np.where(np.stack(bits), 8, -8).astype(np.float16)
        return MaskPredictions(np.array(prompt), np.array(score, np.float32), np.array(stability, np.float32), logits)

    def _answers(self, n: int, box: shapely.Polygon | None) -> bool:
        if box is None:
            return not self.regions[n].prompt_only
        own = shapely.box(*self.regions[n].shape.bounds)
        return bool(own.intersection(box).area >= 0.5 * own.union(box).area)

    def masks(self, predictions: MaskPredictions) -> list[Mask]:
        found = []
        for logits, score in zip(predictions.logits, predictions.score, strict=True):
            rows, columns = np.flatnonzero((logits > 0).any(1)), np.flatnonzero((logits > 0).any(0))
            box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
            found.append(upsample(logits, box, self.image, self.mask_scale, float(score)))
        return found


@dataclass
class PaintedSegmenter:
    """`PromptedSegmenter` of several photographs, told apart by their pixels."""

    views: list[PaintedView]
    name: str = "painted"

    def view(self, image: Image) -> PaintedView:
        """That of a photograph, or of a part of one."""
        for view in self.views:
            if view.image.rgb.shape == image.rgb.shape and np.array_equal(view.image.rgb, image.rgb):
                return view
        return next(part for part in (_part(view, image) for view in self.views) if part is not None)

    def segment(self, image: Image) -> list[Mask]:
        view = self.view(image)
        return [Mask(0, 0, bits_of(r.shape, image), r.score) for r in view.regions if not r.prompt_only]


def _part(view: PaintedView, image: Image) -> PaintedView | None:
    """The part of a view that an image was cut out of; None where it is of another photograph."""
    if image.width > view.image.width or image.height > view.image.height:
        return None
    x, y = cv2.minMaxLoc(cv2.matchTemplate(view.image.rgb, image.rgb, cv2.TM_SQDIFF))[2]
    if not np.array_equal(view.image.rgb[y : y + image.height, x : x + image.width], image.rgb):
        return None
    frame, regions = shapely.box(0, 0, image.width, image.height), []
    for region in view.regions:
        shape = shapely.intersection(shapely.transform(region.shape, lambda xy: xy - [x, y]), frame)
        if shape.area > 0:
            regions.append(dataclasses.replace(region, shape=shape))
    return PaintedView(image, regions)


def bits_of(shape: shapely.Polygon, image: Image) -> NDArray[np.bool_]:
    """(height, width)"""
    bits = np.zeros((image.height, image.width), np.uint8)
    cv2.fillPoly(bits, [np.round((shapely.get_coordinates(shape.exterior) - 0.5) * 16).astype(np.int32)], 1, shift=4)
    return bits.astype(bool)


def blank(width: int = MASK_SIDE, height: int = MASK_SIDE, seed: int = 0) -> Image:
    """A photograph of noise."""
    noise = np.random.default_rng(seed).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return Image(np.ascontiguousarray(noise))
