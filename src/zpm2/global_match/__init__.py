"""Global matching (paper 3.3): where each polygon should be in the other image, by initial geometry and the pyramid."""

from zpm2.global_match.candidates import Candidates, search_candidates
from zpm2.global_match.initial import InitialGeometry, PriorLocations, initial_geometry, points_with_data
from zpm2.global_match.pyramid import PyramidLocations, locate

__all__ = [
    "Candidates",
    "InitialGeometry",
    "PriorLocations",
    "PyramidLocations",
    "initial_geometry",
    "locate",
    "points_with_data",
    "search_candidates",
]
