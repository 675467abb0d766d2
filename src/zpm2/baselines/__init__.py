"""The classical methods that the paper compares with: shape alone, every polygon against every other (paper 4.1.1)."""

from zpm2.baselines.inner_distance import InnerDistance
from zpm2.baselines.matcher import METHODS, BaselineMatcher, ShapeMethod
from zpm2.baselines.shape_context import ShapeContext

__all__ = ["METHODS", "BaselineMatcher", "InnerDistance", "ShapeContext", "ShapeMethod"]
