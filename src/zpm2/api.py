"""One entry for any two photographs: `match` for a pair, `Matcher` for many, and the methods by name.

Commands and the other rooms of the package match pairs through this module only, so that none of them can miss an
option.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.config import Config
from zpm2.errors import ConfigError
from zpm2.features import PointMatcher
from zpm2.photos.source import ImageLike, Source, opened
from zpm2.pipeline import PairMatcher
from zpm2.result import MatchResult
from zpm2.runtime import Progress
from zpm2.segment.protocol import Segmenter
from zpm2.tiled.run import TiledRun
from zpm2.tiled.whole import in_tiles, match_whole, min_areas

METHODS = ("zpm2", "shape-context", "idsc")


class Matcher:
    """Finds and matches the polygons of pairs of any size. Arguments are those of `PairMatcher`.

    Files are read by windows where that pays (`photos.source.open_source`), georeferences are kept. By `tiles.mode` a
    pair is matched as a whole, or in tiles. `kept` is a folder for finished tiles: a run that was interrupted goes on
    from there, if photographs, configuration and version are the same, and `say` is told how many tiles it took.
    """

    def __init__(
        self,
        config: Config | str = "default",
        *,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
        points: PointMatcher | None = None,
        progress: Progress = lambda stage, share: None,
        say: Callable[[str], None] = lambda text: None,
        kept: str | Path | None = None,
    ) -> None:
        self.config = configuration.preset(config) if isinstance(config, str) else config
        self.progress, self.say = progress, say
        self.kept = None if kept is None else Path(kept)
        self._whole = PairMatcher(self.config, segmenter=segmenter, points=points, progress=progress, say=say)
        self._points, self._segmenter_given = points, segmenter is not None

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair. Inputs are those of `PairMatcher`, and rasters of any size (extra `geo`).

        Raises `InputError` for what cannot be read as a photograph, `OutputError` where `kept` cannot be written.
        Threads and forks are as with `PairMatcher`.
        """
        limit = memory.within(self.config.max_memory)
        with self._whole.lock, limit, opened(left, right, self.config.raster) as sources:
            tiles, said = self._by_tiles(sources)
            if not tiles:
                return match_whole(self._whole, sources, self.config)
            smallest = min_areas(sources, self.config)
            run = TiledRun(sources, smallest, self._whole, self._points, self.say, self.kept, said)
            return run.result().with_gis_messages()

    def _by_tiles(self, sources: Sequence[Source]) -> tuple[bool, list[str]]:
        """Whether a pair goes by tiles, and the warning that only the budget of memory makes it. `InputError` where it
        does not fit into that."""
        config, given = self.config, self._segmenter_given
        sizes = [(source.width, source.height) for source in sources]
        tiles, said = in_tiles(sources, config), []
        needed = estimate.whole(config, sizes, given)
        held = sum(source.held for source in sources)
        less = config.tiles.mode == "auto" and estimate.in_tiles(config, sizes, held, given) < needed
        if not tiles and less and needed > memory.budget():
            tiles = True
            said.append(
                f"matched in tiles, as it needs about {memory.in_words(needed)} of memory as a whole, more than "
                f"{memory.whose()}"
            )
        if tiles:
            estimate.refuse_in_tiles(config, sizes, held, given)
        else:
            estimate.refuse_whole(config, sizes, given)
        return tiles, said


def match(
    left: ImageLike,
    right: ImageLike,
    config: Config | str | None = None,
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
) -> MatchResult:
    """Match the polygons of one pair of photographs of any size. For many pairs, keep a `Matcher`.

    The options are those of `zpm2 match`. `config` is a whole configuration, or the name of a preset, in the place of
    `preset`; the other options are laid over it. `ConfigError` for a value that does not exist, else as `Matcher`.
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


def finished(result: MatchResult, non_overlapping: bool, outlines: bool) -> MatchResult:
    """A result as it was asked for: without overlaps, with homologous outlines."""
    result = result.flatten() if non_overlapping else result
    return result.with_outlines() if outlines else result


def own_regions(
    segmenter: str | None, left: str | Path | None, right: str | Path | None, config: Config
) -> tuple[Segmenter, Segmenter] | None:
    """What gives the regions of two files, where these are named; `ConfigError` where only one is, or another segmenter
    beside them."""
    if segmenter != "precomputed" and left is None and right is None:
        return None
    if segmenter not in (None, "precomputed") or left is None or right is None:
        raise ConfigError("own regions need all of: --segmenter precomputed --left-regions FILE --right-regions FILE")
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    sides = [PrecomputedSegmenter(path, config.vectorize, config.segment.min_area) for path in (left, right)]
    return sides[0], sides[1]


def check_method(name: str) -> None:
    """`ConfigError` for a name that is not in `METHODS`."""
    if name not in METHODS:
        raise ConfigError(f"unknown method '{name}'; methods are: {', '.join(METHODS)}")


def open_method(name: str, config: Config, **options: Any) -> Callable[[Any, Any], MatchResult]:
    """What matches a pair by that method. `options` are those that `Matcher` and `BaselineMatcher` share:
    segmenter, progress, say; the former takes `kept` as well."""
    check_method(name)
    if name == "zpm2":
        return Matcher(config, **options)
    from zpm2.baselines import BaselineMatcher

    return BaselineMatcher(name, config, **options)
