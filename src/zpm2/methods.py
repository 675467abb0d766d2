"""Whole methods by name: the paper's, and the classical ones that it compares with."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.result import MatchResult

METHODS = ("zpm2", "shape-context", "idsc")


def check_method(name: str) -> None:
    """`ConfigError` for a name that is not in `METHODS`."""
    if name not in METHODS:
        raise ConfigError(f"unknown method '{name}'; methods are: {', '.join(METHODS)}")


def open_method(name: str, config: "Config", **options: Any) -> "Callable[[Any, Any], MatchResult]":
    """What matches a pair by that method. `options` are those that `TiledMatcher` and `BaselineMatcher` share:
    segmenter, progress, say; the former takes `kept` as well."""
    check_method(name)
    if name == "zpm2":
        from zpm2.tiled import TiledMatcher

        return TiledMatcher(config, **options)
    from zpm2.baselines import BaselineMatcher

    return BaselineMatcher(name, config, **options)
