"""Polygons of a result as labelling tools read them, a document for each photograph."""

from functools import partial
from pathlib import Path

from zpm2.formats.coco import REGION
from zpm2.formats.properties import polygon_properties
from zpm2.formats.regions import cvat, labelme, yolo
from zpm2.formats.regions.region import Begin, CarriedRegion, GivenRegion
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.model import SIDES, Counterpart, Polygon, counterparts


def write(begin: Begin, kind: str, result: PairResult, folder: Path) -> None:
    """Writes left.KIND and right.KIND with the ending of the format. Polygons without a label are of the class
    "region"."""
    sides = result.left, result.right
    labels = sorted({polygon.label or REGION for side in sides for polygon in side.polygons})
    for name, side in zip(SIDES, sides, strict=True):
        partners = counterparts(result.matches, name)
        regions = [
            _region(polygon, row, partners.get(polygon.id), side.unmatched.get(polygon.id))
            for row, polygon in enumerate(side.polygons)
        ]
        document = begin([each.region for each in regions], labels)
        document.write(folder / document.names(f"{name}.{kind}")[0], regions, side)


def _region(polygon: Polygon, row: int, partner: Counterpart | None, unmatched: str | None) -> CarriedRegion:
    ours = {"id": polygon.id, **polygon_properties(polygon, partner, unmatched)}
    region = GivenRegion((), polygon.id, label=polygon.label or REGION, properties=polygon.properties, row=row)
    return CarriedRegion(region, polygon.shape, {key: value for key, value in ours.items() if value is not None})


for kind, begin, names in (
    ("cvat", cvat.begin, [f"{name}.cvat.xml" for name in SIDES]),
    ("labelme", labelme.begin, [f"{name}.labelme.json" for name in SIDES]),
    ("yolo", yolo.begin, [*(f"{name}.yolo.txt" for name in SIDES), yolo.NAMES]),
):
    register(OutputFormat(kind, tuple(names), partial(write, begin, kind)))
