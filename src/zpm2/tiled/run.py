"""Matches one large pair: detects regions in tiles, stitches them, and matches the stitched regions.

After stitching, the regions of both photographs are matched in blocks (`blocks`). Matches of single tiles are dropped,
so that a region that lies in two tiles has only one partner.
"""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from zpm2.config import Config
from zpm2.errors import ConfigError, InputError
from zpm2.features import PointMatcher, weights_notes
from zpm2.files.photo_paths import absolute
from zpm2.global_match import initial_geometry
from zpm2.global_match.chance import MIRRORED
from zpm2.guided.regions import no_matches
from zpm2.local_match.unmatched import with_reasons
from zpm2.model import THIN, ImagePolygons, PointMatches, PolygonArrays, thin
from zpm2.model.messages import Note, about, split
from zpm2.photos.checks import MIN_SIDE
from zpm2.photos.gdal import page_and_file
from zpm2.photos.source import Source, reduced
from zpm2.pipeline import PairMatcher, plugin_code
from zpm2.result import MatchResult
from zpm2.runtime import StageTimer
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.segment.protocol import PolygonSource, notes_of
from zpm2.tiled.blocks import LargePair, match_blocks
from zpm2.tiled.cells import cells, warped_by_cells
from zpm2.tiled.elsewhere import TileOrder, TileWorkers
from zpm2.tiled.join import given_regions, join_points, join_regions
from zpm2.tiled.stitch import StitchedRegions
from zpm2.tiled.tile import SIDES, Tile, TileCache, TilePart, key
from zpm2.tiled.tile_matcher import TileMatcher, weights_only
from zpm2.verify import judged, same_scene_matches

# stages of the configuration that affect the content of a tile
STAGES = ("segment", "vectorize", "points", "global_match", "local_match", "guided", "raster", "tiles", "seed")


@dataclass(eq=False)
class TiledRun:
    """One run over a pair in tiles, with the configuration, segmenters and progress of `matcher`."""

    sources: tuple[Source, Source]
    min_areas: tuple[float, float]  # px^2, the smallest polygon of the left and the right photograph
    matcher: PairMatcher
    points: PointMatcher | None = None  # replaces the configured matcher
    say: Callable[[str], None] = lambda text: None
    cache: Path | None = None  # folder for finished tiles
    messages: list[str] = field(default_factory=list)  # warnings and notes for the result
    workers: TileWorkers | None = None  # processes that make the tiles, in `cache`

    def result(self) -> MatchResult:
        """Match the pair."""
        config, progress = self.matcher.config, self.matcher.progress
        used = replace(config, tiles=replace(config.tiles, size=tile_size(config, self.sources)))
        timer = StageTimer(weights_only(progress))
        with timer("load"):
            segmenters = self.matcher.segmenters()
        given = (segmenters[0], segmenters[1]) if all(isinstance(s, PolygonSource) for s in segmenters) else None
        cache = self._cache()
        elsewhere = None if self.workers is None else self._elsewhere(self.workers, used, given is not None, cache)
        own = None if given else segmenters
        finder = TileMatcher(self.sources, used, own, self.points, progress, timer, cache, elsewhere)
        tiles = finder.tiles()
        if cache.reused:
            self.say(f"{cache.reused} of {len(tiles)} tiles were finished by an earlier run")
        points = join_points(tiles, used)
        with timer("stitch"):
            stitched = self._regions(tiles, used)
        polygons = PolygonArrays(stitched[0].polygons), PolygonArrays(stitched[1].polygons)
        with timer("match"):
            local = used.local_match
            forth = list(cells(polygons[0], points, used))
            back = list(cells(polygons[1], PointMatches(points.right, points.left, points.score), used))
            warped = warped_by_cells(polygons[0], forth, local), warped_by_cells(polygons[1], back, local)
            pair = LargePair(self.sources, polygons, (stitched[0].guided, stitched[1].guided))
            matches = match_blocks(pair, forth, warped[0], used, lambda share: progress("match", share))
            matches, rejected = judged(matches, local, given is not None)
            self.messages += rejected
            some = points[np.arange(0, len(points), len(points) // used.tiles.max_points + 1)]
            initial = initial_geometry(some, used.global_match, used.seed)
            matches = same_scene_matches(matches, initial.same_scene)
        with timer("explain"):
            overviews = [reduced(source, used.tiles.overview) for source in self.sources]
            sides = [
                ImagePolygons(source.width, source.height, arrays.polygons, absolute(source.path), image, source.geo)
                for source, arrays, image in zip(self.sources, polygons, overviews, strict=True)
            ]
            sides = list(with_reasons((sides[0], sides[1]), matches, warped, local))
        if initial.mirrored:
            self.messages.append(MIRRORED)
        if not initial.supported:
            self.messages.append(
                f"the photographs may not show the same scene: only {len(points)} homologous points agree with their "
                "neighbours"
            )
        warnings, notes = split([*self._source_notes(), *self.messages, *no_matches(matches)])
        return MatchResult(
            left=sides[0],
            right=sides[1],
            matches=matches,
            points=points,
            fundamental=initial.fundamental,
            homography=initial.homography,
            config=config.to_dict(),
            timings=timer.seconds,
            warnings=warnings,
            notes=notes,
            same_scene=initial.same_scene,
        )

    def _elsewhere(
        self, workers: TileWorkers, config: Config, given: bool, cache: TileCache
    ) -> Callable[[Sequence[TilePart]], None]:
        """Has tiles made by workers. `ConfigError` where those cannot see the photographs, or the folder of tiles."""
        paths = [source.path for source in self.sources if not source.pixels_given]
        names = [page_and_file(path) for path in paths if path is not None]
        files = [page + os.path.abspath(file) for page, file in names]
        if len(files) < 2 or cache.folder is None:
            raise ConfigError("workers need photographs that are files, and a folder for finished tiles (`kept`)")
        order = TileOrder((files[0], files[1]), config, given, os.path.abspath(cache.folder))
        return lambda parts: workers.make(order, parts, self.say)

    def _cache(self) -> TileCache:
        """The finished tiles of this pair, configuration and code."""
        if self.cache is None:
            return TileCache(None, "")
        segmenters = self.matcher.segmenters()
        points = [] if self.points is None else [self.points.name]
        name = "/".join([*(s.name for s in segmenters), *points, *plugin_code(self.matcher.config)])
        regions = [segmenter.path for segmenter in segmenters if isinstance(segmenter, PrecomputedSegmenter)]
        values = self.matcher.config.to_dict()
        return TileCache(self.cache, key(self.sources, {stage: values[stage] for stage in STAGES}, name, regions))

    def _regions(self, tiles: Sequence[Tile], config: Config) -> tuple[StitchedRegions, StitchedRegions]:
        first, second = self.matcher.segmenters()
        if isinstance(first, PolygonSource) and isinstance(second, PolygonSource):
            left = given_regions(first, self.sources[0], self.min_areas[0])
            self.messages += about("left regions", notes_of(first))
            right = given_regions(second, self.sources[1], self.min_areas[1])
            self.messages += about("right regions", notes_of(second))
            return left, right
        stitched = join_regions(tiles, self.sources, self.min_areas, config)
        for side, regions in zip(SIDES, stitched, strict=True):
            if regions.incomplete:
                self.messages.append(
                    Note(
                        f"{regions.incomplete} pieces of {side} regions that a tile border cut were left out: nowhere "
                        "whole"
                    )
                )
            if not regions.polygons:
                self.messages.append(f"no regions were found in the {side} image")
        return stitched

    def _source_notes(self) -> list[str]:
        notes = [
            text
            for side, source in zip(SIDES, self.sources, strict=True)
            for text in about(f"{side} image", source.notes)
        ]
        notes += [] if self.points is not None else weights_notes(self.matcher.config.points)
        if self.matcher.config.segment.detail.level == "high":
            notes.append("no closer look (--detail high): tiles show each part closer already, make tiles.size smaller")
        segmenters = self.matcher.segmenters()
        if all(isinstance(segmenter, PolygonSource) for segmenter in segmenters):
            return notes
        return notes + list(dict.fromkeys(note for s in segmenters for note in notes_of(s)))


def tile_size(config: Config, sources: Sequence[Source]) -> int:
    """The side of a tile, px; smaller for thin photographs, so that a segmenter can take the tiles.

    `InputError` if a photograph is too thin for a view of all of it.
    """
    size, long_ones = config.tiles.size, [source for source in sources if thin(source.width, source.height)]
    for source in long_ones:
        width, height = source.width, source.height
        if min(width, height) < MIN_SIDE * max(1.0, math.sqrt(width * height) / config.tiles.overview):
            raise InputError(
                f"{source.path or 'a photograph'} is {width} x {height} px, too long and thin: cut it in pieces"
            )
    shortest = min(min(source.width, source.height) for source in sources)
    return min(size, THIN // 2 * shortest) if long_ones else size
