"""The report page of carried regions."""

from collections.abc import Sequence

import numpy as np

from zpm2.carry.outcome import Outcome
from zpm2.config import RasterConfig
from zpm2.errors import Failed
from zpm2.formats.convert import Members
from zpm2.formats.regions.region import GivenRegion, Shape
from zpm2.formats.saving import Files
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.polygons.repair import largest
from zpm2.polygons.shapes import from_shape
from zpm2.result import MatchResult
from zpm2.view import report
from zpm2.view.report.content import Words


def report_files(
    sides: tuple[ImagePolygons, ImagePolygons],
    regions: Sequence[GivenRegion],
    shapes: Sequence[Shape | None],
    outcomes: Sequence[Outcome],
    document: Members,
) -> Files:
    """Name and content of `report.html` and of its tiles: each given region with its outline in the other photograph.

    sides: the photographs; their polygons are not used. document: the content of `carry.json`. The page shows the
    largest part of a region, under its id where all regions have whole numbers that differ, else under its row.
    `InputError` where a photograph is no longer where it was.
    """
    left, right, matches = list[Polygon](), list[Polygon](), list[PolygonMatch]()
    stages, remarks, lost = dict[int, str](), dict[int, str](), dict[int, str]()
    places = []
    own = [region.id for region in regions if region.id is not None]
    numbers = own if len(set(own)) == len(regions) else range(len(regions))
    for k, region, shape, outcome in zip(numbers, regions, shapes, outcomes, strict=True):
        if shape is None:
            continue
        left.append(_largest(shape, k, region))
        remarks[k] = outcome.reason
        if outcome.shape is None:
            lost[k] = outcome.status
            continue
        right.append(_largest(outcome.shape, k, region))
        stages[k] = outcome.status
        visible = np.nan if outcome.visible is None else outcome.visible
        matches.append(
            PolygonMatch(k, k, outcome.confidence, np.nan, outcome.points, "guided", outcome.agreement, visible=visible)
        )
        places.append((left[-1].center, right[-1].center))
    centers = np.array(places, np.float64).reshape(-1, 2, 2)
    none = Failed("zpm2 carry keeps none")
    result = MatchResult(
        ImagePolygons(sides[0].width, sides[0].height, left, sides[0].path, geo=sides[0].geo, unmatched=lost),
        ImagePolygons(sides[1].width, sides[1].height, right, sides[1].path, geo=sides[1].geo),
        matches,
        PointMatches(centers[:, 0], centers[:, 1], np.ones(len(centers))),
        none,
        none,
        document["config"],
        document["timings"],
    )
    return report.files(result, document, RasterConfig(), Words("carry.json", stages, remarks))


def _largest(shape: Shape, number: int, region: GivenRegion) -> Polygon:
    part = from_shape(largest(shape), number)
    return Polygon(number, part.exterior, part.holes, label=region.label)
