"""Where each polygon should be in the other image, coarsely: initial geometry, then the pyramid (paper 3.3)."""

from zpm2.global_match.candidates import Candidates, search_candidates
from zpm2.global_match.initial import InitialGeometry, PriorLocations, initial_geometry
from zpm2.global_match.pyramid import PyramidLocations, place

__all__ = [
    "Candidates",
    "InitialGeometry",
    "PriorLocations",
    "PyramidLocations",
    "initial_geometry",
    "place",
    "search_candidates",
]
