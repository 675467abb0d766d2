"""left.coco.json and right.coco.json."""

import json
from pathlib import Path

from zpm2.files.writing import atomic_write
from zpm2.formats.coco import coco
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.model import SIDES, counterparts
from zpm2.polygons.rasterize import rasterize


def write(result: PairResult, folder: Path) -> None:
    """Writes both files, see `formats.coco`."""
    for name, side in zip(SIDES, (result.left, result.right), strict=True):
        masks = (rasterize(polygon.shape) for polygon in side.polygons)
        image = side.path or name, side.width, side.height
        document = coco(side.polygons, masks, counterparts(result.matches, name), *image, side.unmatched)
        atomic_write(folder / f"{name}.coco.json", json.dumps(document))


register(OutputFormat("coco", tuple(f"{name}.coco.json" for name in SIDES), write))
