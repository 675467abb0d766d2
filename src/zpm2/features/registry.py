"""Point matchers by name.

A matcher registers itself where it is defined. The files of `zpm2.features.methods` are found because they lie there; a
file from elsewhere takes part once it is imported:

    @point_matcher("mine")
    def mine(config: PointsConfig, device: str, progress: Progress | None) -> PointMatcher: ...
"""

import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module

from zpm2.config import PointsConfig
from zpm2.errors import ConfigError, did_you_mean
from zpm2.features import methods
from zpm2.features.combined import CombinedMatcher
from zpm2.features.protocol import PointMatcher
from zpm2.features.rotated_retry import RotatedRetry
from zpm2.weights import Progress

Build = Callable[[PointsConfig, str, Progress | None], PointMatcher]  # of the configuration and "cpu" or "cuda"


@dataclass(frozen=True)
class PointMethod:
    """A registered point matcher."""

    name: str  # in `PointsConfig.methods`
    build: Build
    bytes_per_pixel: float  # memory at its peak, for each pixel of a photograph as it sees it; 0: not measured
    full_size: bool  # whether it sees photographs as they are, and not at `PointsConfig.max_size`


_METHODS: dict[str, PointMethod] = {}
METHODS: Mapping[str, PointMethod] = _METHODS


def point_matcher(name: str, *, bytes_per_pixel: float = 0.0, full_size: bool = False) -> Callable[[Build], Build]:
    """Register the function that builds the matcher `name`, see `PointMethod`. `ValueError` for a taken name."""

    def register(build: Build) -> Build:
        if name in _METHODS:
            raise ValueError(f"two point matchers have the name '{name}'")
        _METHODS[name] = PointMethod(name, build, bytes_per_pixel, full_size)
        return build

    return register


def create(config: PointsConfig, device: str = "cpu", progress: Progress | None = None) -> PointMatcher:
    """The matcher that `config` describes: one method, or several with their matches together.

    `device` is "cpu" or "cuda"; SIFT always runs on the CPU. The same images always give the same points. `progress`
    reports downloads. Raises `ConfigError` for a name that is not in `METHODS`, before anything is loaded, and
    `WeightsError` where weights cannot be had.
    """
    check_methods(config)
    matcher = _combined(config, device, progress)
    if not config.rotated_retry:
        return matcher
    fewer = replace(config, max_keypoints=min(config.max_keypoints, config.retry.max_keypoints))
    return RotatedRetry(matcher, cache(lambda: _combined(fewer, device, progress)), config.max_size, config.retry)


def check_methods(config: PointsConfig) -> None:
    """`ConfigError` for a name that is not in `METHODS`."""
    for name in config.methods:
        if name not in METHODS:
            raise ConfigError(
                f"unknown point method '{name}'{did_you_mean(name, METHODS)}; methods are: {', '.join(METHODS)}"
            )


def _combined(config: PointsConfig, device: str, progress: Progress | None) -> CombinedMatcher:
    matchers = [METHODS[name].build(config, device, progress) for name in config.methods]
    return CombinedMatcher(matchers, config.min_score, config.merge_px)


for _module in pkgutil.iter_modules(methods.__path__):
    import_module(f"{methods.__name__}.{_module.name}")
