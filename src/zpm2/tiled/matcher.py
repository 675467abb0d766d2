"""Pairs of any size: small ones as they are, large ones tile by tile (`run`)."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.config import Config
from zpm2.detect.protocol import Segmenter
from zpm2.errors import ConfigError
from zpm2.features import PointMatcher
from zpm2.io.images import whole
from zpm2.io.source import ImageLike, Source, opened
from zpm2.model import Image, thin
from zpm2.pipeline import PolygonMatcher
from zpm2.regions import Progress
from zpm2.result import MatchResult
from zpm2.tiled.run import SIDES, Run

LARGE = 16_000_000  # px, a photograph beyond which `tiles.mode` auto chooses tiles, as it does for thin ones


class TiledMatcher:
    """Finds and matches the polygons of pairs of any size. Arguments are those of `PolygonMatcher`.

    Files are read by windows where that pays (`io.source.open_source`), georeferences are kept. By `tiles.mode` a pair
    is matched as a whole, or in tiles. `kept` is a folder for finished tiles: a run that was interrupted goes on from
    there, if photographs, configuration and version are the same, and `say` hears how many tiles it took.
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
        self._whole = PolygonMatcher(self.config, segmenter=segmenter, points=points, progress=progress, say=say)
        self._points, self._segmenter_given = points, segmenter is not None

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair. Inputs are those of `PolygonMatcher`, and rasters of any size (extra `geo`).

        Raises `InputError` for what cannot be read as a photograph, `OutputError` where `kept` cannot be written.
        Threads and forks are as with `PolygonMatcher`.
        """
        raster, limit = self.config.raster, memory.within(self.config.max_memory)
        with self._whole.turns, limit, opened(left, right, raster.bands, raster.gsd) as sources:
            tiles, said = self._by_tiles(sources)
            if not tiles:
                return match_whole(self._whole, sources, self.config)
            least = _least_areas(sources, self.config)
            run = Run(self.config, sources, least, self._whole, self._points, self.progress, self.say, self.kept, said)
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


def in_tiles(sources: Sequence[Source], config: Config) -> bool:
    """Whether a pair is matched in tiles."""
    mode = config.tiles.mode
    large = any(s.width * s.height > LARGE or thin(s.width, s.height) for s in sources)
    return mode == "on" or (mode == "auto" and large)


def match_whole(
    match: Callable[[Image, Image], MatchResult], sources: tuple[Source, Source], config: Config
) -> MatchResult:
    """What `match` makes of both photographs, each as a whole, with where they lie on the ground."""
    least = _least_areas(sources, config)
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
    return result.without_smaller(*least) if config.raster.min_area_m2 else result


def _least_areas(sources: tuple[Source, Source], config: Config) -> tuple[float, float]:
    """px^2, the smallest polygon of the left and the right photograph."""
    return _least(sources[0], config), _least(sources[1], config)


def _least(source: Source, config: Config) -> float:
    if not config.raster.min_area_m2:
        return config.segment.min_area
    if source.geo.gsd is None:
        raise ConfigError("a least area in m^2 needs the size of a pixel on the ground: give it as --gsd M_PER_PX")
    return max(config.segment.min_area, config.raster.min_area_m2 / source.geo.gsd**2)
