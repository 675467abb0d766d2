"""The input of the local matcher."""

from dataclasses import dataclass, field

import shapely

from zpm2.global_match import Candidates, InitialGeometry, PyramidLocations
from zpm2.guided.prior import GuidedPrior
from zpm2.model import Image, PolygonArrays
from zpm2.polygons.once import Known

KnownOverlaps = Known[tuple[shapely.Geometry, float, float, float]]
KnownEvidence = Known[tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class MatchProblem:
    """Two images with their polygons, and what is known about these before they are compared."""

    images: tuple[Image, Image]
    polygons: tuple[PolygonArrays, PolygonArrays]
    initial: InitialGeometry
    locations: PyramidLocations  # of the left polygons in the right image
    candidates: Candidates
    guided_prior: GuidedPrior | None = None  # where guided re-detection found the polygons
    # How pairs overlap, and what `verify` found out about them: problems that share this have the same images, points
    # and configuration
    known: KnownOverlaps = field(default_factory=dict)
    evidence: KnownEvidence = field(default_factory=dict)
