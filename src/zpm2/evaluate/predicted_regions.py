"""Regions of an earlier evaluation, so that methods and settings are compared on the same polygons."""

import dataclasses
from pathlib import Path
from typing import Literal

from zpm2.errors import InputError
from zpm2.evaluate import predictions
from zpm2.evaluate.pairs import EvalPair
from zpm2.model import Image, Mask, Polygon
from zpm2.model.messages import Note
from zpm2.polygons.rasterize import rasterize
from zpm2.result import MatchResult


class PredictedRegions:
    """The polygons of the predictions in `out`, the folder of an evaluation of the same data set.

    `sides` are the left and the right segmenter; `set_pair` chooses the pair whose regions they give.
    """

    def __init__(self, out: Path) -> None:
        if not (out / "run.json").exists():
            raise InputError(f"{out} holds no predictions to take regions from: give the folder of a zpm2 eval")
        self.out = out
        self.result: MatchResult | None = None
        self.sides = PredictedRegionsSegmenter(self, "left"), PredictedRegionsSegmenter(self, "right")

    def set_pair(self, pair: EvalPair) -> None:
        """`InputError` where the pair has no prediction in the folder, or one of other photographs."""
        result = predictions.load(pair, self.out)
        if not isinstance(result, MatchResult):
            raise InputError(f"no regions of {pair.name} in {self.out}" + (f": {result}" if result else ""))
        if not predictions.is_current(pair, self.out):
            raise InputError(f"the regions of {pair.name} in {self.out} are of other photographs: evaluate it anew")
        self.result = result


class PredictedRegionsSegmenter:
    """One side of `PredictedRegions`, as a segmenter that gives polygons."""

    name = "kept"

    def __init__(self, kept: PredictedRegions, side: Literal["left", "right"]) -> None:
        self.kept, self.side = kept, side
        self.notes = [Note(f"taken from {kept.out}, not detected")]

    def polygons(self, image: Image) -> list[Polygon]:
        """`InputError` if the photograph had another size when its regions were found."""
        side = getattr(self.kept.result, self.side)
        if (side.width, side.height) != (image.width, image.height):
            raise InputError(
                f"the regions in {self.kept.out} are of {side.width} x {side.height} px, {image.path} has "
                f"{image.width} x {image.height} px"
            )
        return list(side.polygons)

    def segment(self, image: Image) -> list[Mask]:
        """The same as pixels."""
        polygons = self.polygons(image)
        return [dataclasses.replace(rasterize(p.shape), score=p.score, label=p.label) for p in polygons]
