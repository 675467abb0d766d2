"""Homologous points between two images (paper 3.2): one call, whatever finds them."""

from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import METHODS, check_methods, combined, create, point_matcher, seen_size, weights_notes

__all__ = [
    "METHODS",
    "PointMatcher",
    "check_methods",
    "combined",
    "create",
    "point_matcher",
    "seen_size",
    "weights_notes",
]
