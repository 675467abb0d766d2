"""Many results at once, for programs that reconstruct from photographs: COLMAP and hloc."""

from zpm2.export.keypoints import Keypoints, PairPoints, collect

__all__ = ["Keypoints", "PairPoints", "collect"]
