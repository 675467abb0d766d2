"""Decides whether a pair is matched in tiles, and matches the others whole."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

from zpm2.config import Config
from zpm2.errors import ConfigError
from zpm2.model import Image, thin
from zpm2.photos.images import whole
from zpm2.photos.source import Source
from zpm2.result import MatchResult
from zpm2.tiled.tile import SIDES


def in_tiles(sources: Sequence[Source], config: Config) -> bool:
    """Whether a pair is matched in tiles."""
    mode = config.tiles.mode
    large = any(s.width * s.height > config.raster.large_px or thin(s.width, s.height) for s in sources)
    return mode == "on" or (mode == "auto" and large)


def match_whole(
    match: Callable[[Image, Image], MatchResult], sources: tuple[Source, Source], config: Config
) -> MatchResult:
    """The result of `match` for both photographs, each as a whole, with their georeferences."""
    smallest = min_areas(sources, config)
    start = perf_counter()
    left, right = (whole(source, f"{name} image") for source, name in zip(sources, SIDES, strict=True))
    seconds = perf_counter() - start
    result = match(left, right)
    timings = {"read": 0.0, **result.timings}
    timings["read"] += seconds
    result = replace(
        result,
        left=replace(result.left, geo=sources[0].geo),
        right=replace(result.right, geo=sources[1].geo),
        timings=timings,
    ).with_gis_messages()
    return result.without_smaller(*smallest) if config.raster.min_area_m2 else result


def min_areas(sources: tuple[Source, Source], config: Config) -> tuple[float, float]:
    """px^2, the smallest polygon of the left and the right photograph."""
    return _min_area(sources[0], config), _min_area(sources[1], config)


def _min_area(source: Source, config: Config) -> float:
    if not config.raster.min_area_m2:
        return config.segment.min_area
    if source.geo.gsd is None:
        raise ConfigError("a minimum area in m^2 needs the ground size of a pixel: give it as --gsd M_PER_PX")
    return max(config.segment.min_area, config.raster.min_area_m2 / source.geo.gsd**2)
