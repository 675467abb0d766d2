"""Homologous points between two images (paper 3.2): one call, whatever finds them."""

from zpm2.features.methods import METHODS, check_methods, create
from zpm2.features.protocol import PointMatcher

__all__ = ["METHODS", "PointMatcher", "check_methods", "create"]
