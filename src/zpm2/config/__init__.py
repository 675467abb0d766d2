"""Every number of the method, one frozen dataclass per stage, and the presets that fill them.

A field is declared with its meaning, unit, range and source beside it (`fields`); it is checked there, listed by
`zpm2 config list`, written to results, and part of what decides whether an earlier run's files may be taken.
"""

from zpm2.config.carry import CarryConfig
from zpm2.config.cloud import CloudConfig
from zpm2.config.global_match import ChanceConfig, GlobalConfig
from zpm2.config.link import LinkConfig
from zpm2.config.load import OPTIONS, assign, load, recorded, with_options
from zpm2.config.local_match import (
    ConfidenceConfig,
    ExclusiveConfig,
    GuidedConfig,
    HomographyConfig,
    LocalConfig,
    OutlineConfig,
    UnmatchedConfig,
    VerifyConfig,
    VisibleConfig,
)
from zpm2.config.photos import (
    BlocksConfig,
    CellsConfig,
    PartnerConfig,
    RasterConfig,
    StitchConfig,
    StretchConfig,
    TilesConfig,
)
from zpm2.config.points import CoarseConfig, EscalateConfig, PointsConfig
from zpm2.config.pose import DegeneracyConfig, FocalConfig, PoseConfig
from zpm2.config.presets import PRESETS, as_config, preset
from zpm2.config.reconstruct import ReconstructConfig
from zpm2.config.robust import MagsacConfig
from zpm2.config.segment import DetailConfig, FamilyConfig, PromptConfig, SegmentConfig, VectorizeConfig
from zpm2.config.stereo import StereoConfig
from zpm2.config.tracks import TracksConfig
from zpm2.config.whole import Config, choices, describe

__all__ = [
    "OPTIONS",
    "PRESETS",
    "BlocksConfig",
    "CarryConfig",
    "CellsConfig",
    "ChanceConfig",
    "CloudConfig",
    "CoarseConfig",
    "ConfidenceConfig",
    "Config",
    "DegeneracyConfig",
    "DetailConfig",
    "EscalateConfig",
    "ExclusiveConfig",
    "FamilyConfig",
    "FocalConfig",
    "GlobalConfig",
    "GuidedConfig",
    "HomographyConfig",
    "LinkConfig",
    "LocalConfig",
    "MagsacConfig",
    "OutlineConfig",
    "PartnerConfig",
    "PointsConfig",
    "PoseConfig",
    "PromptConfig",
    "RasterConfig",
    "ReconstructConfig",
    "SegmentConfig",
    "StereoConfig",
    "StitchConfig",
    "StretchConfig",
    "TilesConfig",
    "TracksConfig",
    "UnmatchedConfig",
    "VectorizeConfig",
    "VerifyConfig",
    "VisibleConfig",
    "as_config",
    "assign",
    "choices",
    "describe",
    "load",
    "preset",
    "recorded",
    "with_options",
]
