"""Whole methods by name: the paper's, and the classical ones that it compares with; and one call for one pair."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zpm2 import config as configuration
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.detect.protocol import Segmenter
    from zpm2.io.source import ImageLike
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


def match(
    left: "ImageLike",
    right: "ImageLike",
    config: "Config | str | None" = None,
    *,
    preset: str = "default",
    segmenter: str | None = None,
    quality: str | None = None,
    left_regions: str | Path | None = None,
    right_regions: str | Path | None = None,
    method: str = "zpm2",
    points: str | Sequence[str] | None = None,
    non_overlapping: bool = False,
    outlines: bool = False,
    tiles: str | None = None,
    bands: str | int | Sequence[int] | None = None,
    gsd: str | float | Sequence[float] | None = None,
    min_area_m2: float | None = None,
    device: str | None = None,
    seed: int | None = None,
    max_memory: str | None = None,
) -> "MatchResult":
    """Match the polygons of one pair of photographs of any size. For many pairs, keep a `TiledMatcher`.

    The options are those of `zpm2 match`. `config` is a whole configuration, or the name of a preset, in the place of
    `preset`; the other options are laid over it. `ConfigError` for a value that does not exist, else as `TiledMatcher`.
    """
    chosen = configuration.preset(preset) if config is None else config
    chosen = configuration.preset(chosen) if isinstance(chosen, str) else chosen
    options: dict[str, Any] = {
        "segmenter": None if segmenter == "precomputed" else segmenter,
        "quality": quality,
        "points": points,
        "tiles": tiles,
        "bands": bands,
        "gsd": gsd,
        "min_area_m2": min_area_m2,
        "device": device,
        "seed": seed,
        "max_memory": max_memory,
    }
    chosen = configuration.with_options(chosen, options)
    own = own_regions(segmenter, left_regions, right_regions, chosen)
    result = open_method(method, chosen, segmenter=own)(left, right)
    return finished(result, non_overlapping, outlines)


def finished(result: "MatchResult", non_overlapping: bool, outlines: bool) -> "MatchResult":
    """A result as it was asked for: without overlaps, with homologous outlines."""
    result = result.flatten() if non_overlapping else result
    return result.with_outlines() if outlines else result


def own_regions(
    segmenter: str | None, left: str | Path | None, right: str | Path | None, config: "Config"
) -> "tuple[Segmenter, Segmenter] | None":
    """What gives the regions of two files, where these are named; `ConfigError` where only one is, or another segmenter
    beside them."""
    if segmenter != "precomputed" and left is None and right is None:
        return None
    if segmenter not in (None, "precomputed") or left is None or right is None:
        raise ConfigError("own regions need all of: --segmenter precomputed --left-regions FILE --right-regions FILE")
    from zpm2.detect.precomputed import PrecomputedSegmenter

    sides = [PrecomputedSegmenter(path, config.vectorize, config.segment.min_area) for path in (left, right)]
    return sides[0], sides[1]
