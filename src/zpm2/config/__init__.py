"""Every number of the method, one frozen dataclass per stage, and the presets that fill them.

A field is declared with its meaning, unit, range and source beside it (`fields`); it is checked there, listed by
`zpm2 config list`, written to results, and part of what decides whether an earlier run's files may be taken.
"""

from zpm2.config.cloud import CloudConfig
from zpm2.config.global_match import ChanceConfig, GlobalConfig
from zpm2.config.load import OPTIONS, assign, load, recorded, with_options
from zpm2.config.local_match import (
    ConfidenceConfig,
    ExclusiveConfig,
    GuidedConfig,
    HomographyConfig,
    LocalConfig,
    OutlineConfig,
    UnmatchedConfig,
)
from zpm2.config.photos import RasterConfig, TilesConfig
from zpm2.config.points import PointsConfig
from zpm2.config.pose import PoseConfig
from zpm2.config.presets import PRESETS, preset
from zpm2.config.segment import PromptConfig, SegmentConfig, VectorizeConfig
from zpm2.config.whole import Config, choices, describe

__all__ = [
    "OPTIONS",
    "PRESETS",
    "ChanceConfig",
    "CloudConfig",
    "ConfidenceConfig",
    "Config",
    "ExclusiveConfig",
    "GlobalConfig",
    "GuidedConfig",
    "HomographyConfig",
    "LocalConfig",
    "OutlineConfig",
    "PointsConfig",
    "PoseConfig",
    "PromptConfig",
    "RasterConfig",
    "SegmentConfig",
    "TilesConfig",
    "UnmatchedConfig",
    "VectorizeConfig",
    "assign",
    "choices",
    "describe",
    "load",
    "preset",
    "recorded",
    "with_options",
]
