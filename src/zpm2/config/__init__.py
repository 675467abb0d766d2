"""Every number of the method, one frozen dataclass per stage, and the presets that fill them.

A field is declared with its meaning, unit, range and source beside it (`fields`); it is checked there, listed by
`zpm2 config list`, written to results, and part of what decides whether an earlier run's files may be taken.
"""

from zpm2.config.cloud import CloudConfig
from zpm2.config.global_match import GlobalConfig
from zpm2.config.load import OPTIONS, assign, load, with_options
from zpm2.config.local_match import GuidedConfig, LocalConfig
from zpm2.config.photos import RasterConfig, StretchConfig, TilesConfig
from zpm2.config.points import PointsConfig
from zpm2.config.pose import PoseConfig
from zpm2.config.presets import PRESETS, preset
from zpm2.config.segment import SegmentConfig, VectorizeConfig
from zpm2.config.whole import Config, choices, describe

__all__ = [
    "OPTIONS",
    "PRESETS",
    "CloudConfig",
    "Config",
    "GlobalConfig",
    "GuidedConfig",
    "LocalConfig",
    "PointsConfig",
    "PoseConfig",
    "RasterConfig",
    "SegmentConfig",
    "StretchConfig",
    "TilesConfig",
    "VectorizeConfig",
    "assign",
    "choices",
    "describe",
    "load",
    "preset",
    "with_options",
]
