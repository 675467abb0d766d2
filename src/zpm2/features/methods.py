"""Point matchers by name."""

import dataclasses
from difflib import get_close_matches
from functools import cache

from zpm2.config import PointsConfig
from zpm2.errors import ConfigError
from zpm2.features.combined import Combined
from zpm2.features.protocol import PointMatcher, SparseMatcher
from zpm2.features.rotated_retry import RotatedRetry
from zpm2.features.sift import RatioMatcher, SiftDetector
from zpm2.weights import Progress

AGAIN = 2048  # points an image in each further look (`rotated_retry`)
METHODS = ("sift", "xfeat", "xfeat-dense", "disk", "aliked", "aliked-n16rot", "aliked-n32", "superpoint")


def create(config: PointsConfig, device: str = "cpu", progress: Progress | None = None) -> PointMatcher:
    """The matcher that `config` describes: one method, or several with their matches together.

    `device` is "cpu" or "cuda"; SIFT always runs on the CPU. The same images always give the same points.
    `progress` is told how downloads get on. Raises `ConfigError` for a name that is not in
    `METHODS`, before anything is loaded, and `WeightsError` where weights cannot be had.
    """
    check_methods(config)
    matcher = _combined(config, device, progress)
    if not config.rotated_retry:
        return matcher
    fewer = dataclasses.replace(config, max_keypoints=min(config.max_keypoints, AGAIN))
    return RotatedRetry(matcher, cache(lambda: _combined(fewer, device, progress)), config.max_size)


def check_methods(config: PointsConfig) -> None:
    """`ConfigError` for a name that is not in `METHODS`."""
    for name in config.methods:
        if name not in METHODS:
            close = get_close_matches(name, METHODS, n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
            raise ConfigError(f"unknown point method '{name}'{hint}; methods are: {', '.join(METHODS)}")


def _combined(config: PointsConfig, device: str, progress: Progress | None) -> Combined:
    return Combined([_build(name, config, device, progress) for name in config.methods], config.min_score)


def _build(name: str, config: PointsConfig, device: str, progress: Progress | None) -> PointMatcher:
    limit = config.max_keypoints
    if name == "sift":
        return SparseMatcher(name, SiftDetector(limit), RatioMatcher())

    from zpm2.features import learned, lightglue, xfeat_dense

    if name == "xfeat-dense":
        return xfeat_dense.XFeatDense(limit, config.max_size, device, progress)
    if name == "xfeat":
        extract, glue = learned.xfeat(limit, device, progress), "xfeat_lighterglue"
    elif name == "disk":
        extract, glue = learned.disk(limit, device, progress), "disk_lightglue"
    elif name == "superpoint":
        extract, glue = learned.superpoint_v1(limit, device, progress), "superpoint_lightglue"
    else:
        model = {"aliked": "n16", "aliked-n16rot": "n16rot", "aliked-n32": "n32"}[name]
        extract, glue = learned.aliked(model, limit, device, progress), "aliked_lightglue"
    detector = learned.NetworkDetector(extract, config.max_size, device)
    return SparseMatcher(name, detector, lightglue.LightGlueMatcher(glue, device, progress))
