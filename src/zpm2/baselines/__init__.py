"""Other methods of matching, on the regions and points of ours: classical shape matching, and recent peers."""

from zpm2.baselines.inner_distance import InnerDistance
from zpm2.baselines.masa import Masa
from zpm2.baselines.matcher import METHODS, BaselineMatcher
from zpm2.baselines.mesa import Mesa
from zpm2.baselines.method import Method, Pairing, RegionPair
from zpm2.baselines.sgam import Sgam
from zpm2.baselines.shape_context import ShapeContext
from zpm2.baselines.vote import Vote

__all__ = [
    "METHODS",
    "BaselineMatcher",
    "InnerDistance",
    "Masa",
    "Mesa",
    "Method",
    "Pairing",
    "RegionPair",
    "Sgam",
    "ShapeContext",
    "Vote",
]
