"""The presets. `paper` holds the values of the paper's "Experimental environment" (4.1.3) wherever it prints one;
`default` is the best that we know, measured (docs/results.md)."""

from zpm2.config.cloud import CloudConfig
from zpm2.config.local_match import GuidedConfig, LocalConfig, VisibleConfig
from zpm2.config.photos import TilesConfig
from zpm2.config.points import EscalateConfig, PointsConfig
from zpm2.config.pose import PoseConfig
from zpm2.config.segment import DetailConfig, SegmentConfig
from zpm2.config.whole import Config
from zpm2.errors import ConfigError, did_you_mean

PRESETS: dict[str, Config] = {
    "paper": Config(),
    "default": Config(
        segment=SegmentConfig(quality="fast", padding=128, vicinity=6, detail=DetailConfig(level="auto")),
        points=PointsConfig(escalate=EscalateConfig(on=True)),
        local_match=LocalConfig(
            shape="overlap", few_points=True, min_overlap=0.35, judge="on", visible=VisibleConfig(on=True)
        ),
        guided=GuidedConfig(direction="both"),
        tiles=TilesConfig(mode="auto"),
        pose=PoseConfig(estimator="auto", noise_px=0.75, starts=10, points="all", crops="rectified", bucket=50),
        cloud=CloudConfig(diffusion="surface"),
    ),
}


def preset(name: str) -> Config:
    """The configuration of that name; `ConfigError` names the ones that exist."""
    if name not in PRESETS:
        raise ConfigError(f"unknown preset '{name}'{did_you_mean(name, PRESETS)}; presets are: {', '.join(PRESETS)}")
    return PRESETS[name]


def as_config(config: Config | str) -> Config:
    """A `Config` as it is, or the preset of that name; `ConfigError` for anything else."""
    if isinstance(config, Config):
        return config
    if isinstance(config, str):
        return preset(config)
    raise ConfigError(
        f"config is a zpm2.Config or the name of a preset, got {type(config).__name__}: make one with "
        "zpm2.config.load(FILE) or zpm2.Config.from_dict(VALUES)"
    )
