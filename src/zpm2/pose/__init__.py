"""Relative camera pose from matched polygons (paper 3.5.1)."""

from zpm2.pose.estimators import ESTIMATORS, PoseEstimate, PoseEstimator, open_estimator
from zpm2.pose.rectify import rectify
from zpm2.pose.relative import PoseFinder
from zpm2.pose.result import PoseResult, RelativePose
from zpm2.pose.run import OrientedPair, find
from zpm2.stereo.camera_check import checked
from zpm2.stereo.intrinsics import from_exif, guess, read_camera
from zpm2.stereo.rectify import RectifiedPair

__all__ = [
    "ESTIMATORS",
    "OrientedPair",
    "PoseEstimate",
    "PoseEstimator",
    "PoseFinder",
    "PoseResult",
    "RectifiedPair",
    "RelativePose",
    "checked",
    "find",
    "from_exif",
    "guess",
    "open_estimator",
    "read_camera",
    "rectify",
]
