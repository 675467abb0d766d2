"""One large pair, tile by tile.

Tiles come level by level, from all of the photograph down to full resolution. A left tile is matched with the window
of the right photograph to which the points of the level above lead, each such pair by `PairMatcher` as if it were a
pair of its own (points, guided detection). Then each photograph's regions are stitched, and matched once more as a
whole, in blocks (`blocks`): what a tile decided is not asked, so that a region of two tiles has one partner.
"""

import contextlib
import ctypes
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import memory
from zpm2.config import Config, TilesConfig
from zpm2.errors import InputError
from zpm2.features import PointMatcher
from zpm2.features.combined import distinct
from zpm2.files.photo_paths import absolute
from zpm2.global_match import initial_geometry
from zpm2.global_match.chance import MIRRORED
from zpm2.guided.regions import no_matches
from zpm2.local_match.confidence import unsupported
from zpm2.model import THIN, Image, ImagePolygons, Mask, PointMatches, Polygon, PolygonArrays, thin
from zpm2.model.messages import Note, about, split
from zpm2.photos.checks import MIN_SIDE
from zpm2.photos.raster import Window
from zpm2.photos.source import Source, reduced
from zpm2.pipeline import PairMatcher, explained
from zpm2.result import MatchResult
from zpm2.runtime import Progress, StageTimer
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.segment.protocol import PolygonSource
from zpm2.tiled import tile as tiles
from zpm2.tiled import windows
from zpm2.tiled.blocks import match_blocks
from zpm2.tiled.cells import cells, warped_by_cells
from zpm2.tiled.predict import NOISE, Partner, affine, by_georeference, coherent, framed, partner
from zpm2.tiled.stitch import Pieces, Stitched, cut_by_window, stitch
from zpm2.tiled.tile import Tile, TileCache, Windows
from zpm2.tiled.view import View, reduced_size, view

OVERVIEW = 2400  # px, longer side of the pixels that a result keeps
SAME_PX = 2.0  # points of two tiles that are closer in both photographs are one
SPARSE = 1 / 8  # of a finest tile's side: coarser points are kept where no finer one is so near
MOST_POINTS = 10_000  # from which F and H of the whole pair are estimated
UNSEEN = 0.25  # share of a right window that no left tile led to, from which on it is segmented alone
PRIOR_MARGIN = 0.5  # of a mapped window's side, where georeferences alone say where it lies
MUCH_MORE = 0.25  # share of the right photograph up to which the left one's place in it is believed from the start
LEAST_SIDE = 64  # px of a view, below which a window is no partner
SIDES: tuple[Literal["left"], Literal["right"]] = ("left", "right")
REGION_AREA = 100.0  # px^2 of a tile's view, the smallest region that is asked for at any scale


class Run:
    """One pair on its way through the tiles: polygons of at least `least` px^2 (left, right), with the segmenters of
    `matcher`. `kept` is a folder for finished tiles, `said` what the result is to say of why it goes by tiles."""

    def __init__(
        self,
        config: Config,
        sources: tuple[Source, Source],
        least: tuple[float, float],
        matcher: PairMatcher,
        points: PointMatcher | None,
        progress: Progress,
        say: Callable[[str], None],
        kept: Path | None,
        said: Sequence[str] = (),
    ) -> None:
        self.config, self.sources, self.least, self.progress, self.say = config, sources, least, progress, say
        self.messages = list(said)  # warnings, and notes (`messages`)
        self.tiles = _square_enough(config.tiles, sources)
        quiet = _weights_only(progress)
        self.clock = StageTimer(quiet)
        with self.clock("load"):
            segmenters = matcher.segmenters()
        self.given = isinstance(segmenters[0], PolygonSource) and isinstance(segmenters[1], PolygonSource)
        self.segmenters = segmenters
        asked = _NoRegions() if self.given else segmenters
        tile_config = replace(
            self.config,
            segment=replace(self.config.segment, min_area=min(REGION_AREA, self.config.segment.min_area)),
            max_memory=memory.UNLIMITED,  # they were asked about before
        )
        self.whole = PairMatcher(tile_config, segmenter=asked, points=points, progress=quiet)
        once = replace(tile_config, points=replace(tile_config.points, rotated_retry=False))
        self.tile = PairMatcher(once, segmenter=asked, points=points, progress=quiet)
        far = replace(once, points=replace(once.points, max_size=max(max(s.width, s.height) for s in sources)))
        self.points_only = PairMatcher(far, segmenter=_NoRegions(), points=points, progress=quiet)
        stages = ("segment", "vectorize", "points", "global_match", "local_match", "guided", "raster", "tiles", "seed")
        name = "/".join([*(segmenter.name for segmenter in segmenters), *([] if points is None else [points.name])])
        regions = [segmenter.path for segmenter in segmenters if isinstance(segmenter, PrecomputedSegmenter)]
        values = {stage: self.config.to_dict()[stage] for stage in stages}
        self.kept = TileCache(kept, tiles.key(sources, values, name, regions) if kept is not None else "")

    def result(self) -> MatchResult:
        config = self.config
        found = self._tiles()
        points = self._all_points(found)
        with self.clock("stitch"):
            stitched = self._regions(found)
        polygons = PolygonArrays(stitched[0].polygons), PolygonArrays(stitched[1].polygons)
        gamma, side = config.local_match.gamma, self.tiles.size
        with self.clock("match"):
            forth = list(cells(polygons[0], points, side, config))
            back = list(cells(polygons[1], PointMatches(points.right, points.left, points.score), side, config))
            warped = warped_by_cells(polygons[0], forth, gamma), warped_by_cells(polygons[1], back, gamma)
            matches = match_blocks(
                self.sources,
                polygons,
                (stitched[0].guided, stitched[1].guided),
                forth,
                warped[0],
                side,
                config,
                lambda share: self.progress("match", share),
            )
            some = points[np.arange(0, len(points), len(points) // MOST_POINTS + 1)]
            initial = initial_geometry(some, config.global_match, config.seed)
            matches = matches if initial.supported else unsupported(matches)
        with self.clock("explain"):
            overviews = [reduced(source, OVERVIEW) for source in self.sources]
            sides = [
                ImagePolygons(source.width, source.height, arrays.polygons, absolute(source.path), image, source.geo)
                for source, arrays, image in zip(self.sources, polygons, overviews, strict=True)
            ]
            sides = list(explained((sides[0], sides[1]), polygons, matches, warped, config.local_match.min_overlap))
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
            timings=self.clock.seconds,
            warnings=warnings,
            notes=notes,
        )

    # --- tiles

    def _tiles(self) -> list[Tile]:
        left, right = self.sources
        layout, other = (windows.levels(source.width, source.height, self.tiles) for source in (left, right))
        layout, other = _equally_many(layout, other), _equally_many(other, layout)
        total = sum(map(len, layout))
        found: list[Tile] = []
        points = PointMatches.empty()
        for level, level_windows in enumerate(layout):
            here: list[Tile] = []
            for n, window in enumerate(level_windows):
                self.progress("tiles", min(1.0, (len(found) + len(here)) / total))
                there = self._partner(level, window, points)
                here.append(self._tile(level, f"{level}-{n}", window, there))
            if level and self.config.tiles.outside and not self.given:
                here += self._unseen(level, [tile.windows[1] for tile in here], other[level], len(level_windows))
            found += here
            fresh = PointMatches.join([tile.points for tile in here])
            fresh = coherent(fresh, NOISE * windows.side(level_windows[0]))
            points = fresh if len(fresh) else points
        self.progress("tiles", 1.0)
        if self.kept.reused:
            self.say(f"{self.kept.reused} of {len(found)} tiles were finished by an earlier run")
        return found

    def _partner(self, level: int, window: Window, points: PointMatches) -> Partner | None:
        """By the points of the level above; without any, by georeferences, which may be off by a part of a tile. All
        of a left photograph is compared with all of the right one, unless that is known to show much more."""
        left, right = self.sources
        size, overlap = (right.width, right.height), self.config.tiles.overlap
        matrix = affine(points, window, NOISE * windows.side(window)) if level else None
        if matrix is not None:
            found = partner(window, matrix, points, size, overlap)
        else:
            found = partner(window, by_georeference(window, left, right), points, size, PRIOR_MARGIN)
        if level == 0:
            if found is None or windows.area(found.window) > MUCH_MORE * right.width * right.height:
                return Partner((0, 0, *size), max(size) / max(left.width, left.height), 0.0)
        elif found is not None:
            width, height = found.window[2] - found.window[0], found.window[3] - found.window[1]
            least = min(LEAST_SIDE, min(self._shown(window)) / 2)
            if min(width, height) < least * self._reduction(window) * max(1.0, found.scale):
                return None
        return found

    def _tile(self, level: int, name: str, window: Window, there: Partner | None) -> Tile:
        """A left window and its partner."""
        if there is None:
            return self._finished(name, (window, None), lambda looked_at: self._alone(level, looked_at))
        right = self.sources[1].width, self.sources[1].height
        reduction, size = self._reduction(window), self.tiles.size
        if level == 0:
            target, shown = there.window, self._shown(there.window)
        else:
            target, shown = framed(there, reduction, size, self.config.tiles.overlap, right)
        return self._finished(
            name, (window, target), lambda looked_at: self._pair(level, looked_at, window, target, shown, -there.turn)
        )

    def _finished(self, name: str, looked_at: Windows, look: Callable[[Windows], Tile]) -> Tile:
        """A tile from an earlier run, or looked at now, and kept."""
        tile = self.kept.load(name, looked_at)
        if tile is None:
            tile = look(looked_at)
            for stage, seconds in tile.seconds.items():
                self.clock.seconds[stage] = self.clock.seconds.get(stage, 0.0) + seconds
            self.kept.save(name, tile)
            give_back_memory()
        return tile

    def _pair(
        self, level: int, looked_at: Windows, left: Window, right: Window, shown: tuple[int, int], turn: float
    ) -> Tile:
        with self.clock("read"):
            views = (
                view(self.sources[0], left, self._shown(left)),
                view(self.sources[1], right, shown, 0.0 if thin(*shown) else turn),
            )
        images = views[0].image, views[1].image
        if not all(_has_data(image) and min(image.width, image.height) >= MIN_SIDE for image in images):
            return self._apart(level, looked_at, views)
        matcher = self.tile if level else self.whole
        if any(thin(image.width, image.height) for image in images):
            matcher = self.points_only
        result = matcher(*images)
        return tiles.of_pair(level, looked_at, views, result)

    def _alone(self, level: int, looked_at: Windows) -> Tile:
        """One window without a partner."""
        views: list[View | None] = []
        with self.clock("read"):
            for source, window in zip(self.sources, looked_at, strict=True):
                views.append(None if window is None else view(source, window, self._shown(window)))
        return self._apart(level, looked_at, views)

    def _apart(self, level: int, looked_at: Windows, views: Sequence[View | None]) -> Tile:
        """The regions of windows that have nothing in common, where they are asked for."""
        start, found = perf_counter(), []
        for k, each in enumerate(views):
            wanted = each is not None and self.config.tiles.outside and not self.given and _can_be_segmented(each.image)
            found.append((each, self.tile.regions(each.image, SIDES[k])) if wanted and each is not None else None)
        return tiles.apart(level, looked_at, found, perf_counter() - start)

    def _unseen(self, level: int, seen: Sequence[Window | None], own: Sequence[Window], number: int) -> list[Tile]:
        """What of the right photograph no left tile led to, in its own windows of that level."""
        covered = [window for window in seen if window is not None]
        lonely = [window for window in own if _uncovered(window, covered) >= UNSEEN]
        return [
            self._finished(f"{level}-{number + k}", (None, window), lambda looked_at: self._alone(level, looked_at))
            for k, window in enumerate(lonely)
        ]

    def _shown(self, window: Window) -> tuple[int, int]:
        """(width, height) px of the view of a window."""
        return reduced_size(window, self._reduction(window))

    def _reduction(self, window: Window) -> float:
        """px of the photograph per px of the view, which is as long as a tile; of a thin window it has as many px as an
        overview, as it is looked at for points only."""
        if thin(window[2] - window[0], window[3] - window[1]):
            return max(1.0, math.sqrt(windows.area(window)) / OVERVIEW)
        return max(1.0, windows.side(window) / self.tiles.size)

    # --- from tiles to photographs

    def _all_points(self, found: Sequence[Tile]) -> PointMatches:
        """The points of the finest tiles, and coarser ones where there are no finer ones around."""
        points = PointMatches.empty()
        for level in sorted({tile.level for tile in found}, reverse=True):
            of_level = [tile for tile in found if tile.level == level]
            side = max((windows.side(tile.windows[0]) for tile in of_level if tile.windows[0] is not None), default=0)
            more = coherent(PointMatches.join([tile.points for tile in of_level]), NOISE * side)
            if len(points) and len(more):
                away, _ = cKDTree(points.left).query(more.left)
                more = more[away > SPARSE * self.tiles.size]
            points = PointMatches.join([points, more])
        return points[distinct(points, SAME_PX)] if len(points) else points

    def _regions(self, found: Sequence[Tile]) -> tuple[Stitched, Stitched]:
        if self.given:
            return self._given(0), self._given(1)
        cut = self._cut(found)
        stitched = self._stitched(found, cut, 0), self._stitched(found, cut, 1)
        for side, s in zip(SIDES, stitched, strict=True):
            if s.open:
                self.messages.append(
                    Note(f"{s.open} pieces of {side} regions that a tile border cut were left out: nowhere whole")
                )
            if not s.polygons:
                self.messages.append(f"no regions were found in the {side} image")
        return stitched

    def _cut(self, found: Sequence[Tile]) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Of each tile, which of its left and right regions end where the tile does."""
        cut = []
        for tile in found:
            left, right = (
                np.zeros(len(polygons), bool)
                if window is None
                else cut_by_window(polygons, window, (source.width, source.height))
                for polygons, window, source in zip(tile.polygons, tile.windows, self.sources, strict=True)
            )
            i, j = tile.guided.T
            either = left[i] | right[j]  # the answer ends where the question did
            left[i], right[j] = either, either
            cut.append((left, right))
        return cut

    def _stitched(
        self, found: Sequence[Tile], cut: Sequence[tuple[NDArray[np.bool_], NDArray[np.bool_]]], k: int
    ) -> Stitched:
        source, config = self.sources[k], self.config
        polygons: list[Polygon] = []
        looked_at: list[Window] = []
        number, guided, flags, level = [], [], [], []
        for tile, ends in zip(found, cut, strict=True):
            window = tile.windows[k]
            if window is None:
                continue
            asked = np.zeros(len(tile.polygons[k]), bool)
            asked[tile.guided[:, k]] = True
            number.append(np.full(len(tile.polygons[k]), len(looked_at)))
            polygons += tile.polygons[k]
            guided.append(asked)
            flags.append(ends[k])
            looked_at.append(window)
            level.append(tile.level)
        pieces = Pieces(
            polygons,
            np.concatenate(number).astype(np.int64),
            np.concatenate(flags),
            np.concatenate(guided),
            looked_at,
            np.array(level),
        )
        size = source.width, source.height
        return stitch(pieces, size, config.segment.nms_iou, config.vectorize.tolerance, self.least[k])

    def _given(self, k: int) -> Stitched:
        """Regions that were brought along, which no tile cuts."""
        source, segmenter = self.sources[k], self.segmenters[k]
        assert isinstance(segmenter, PolygonSource)
        blank = np.broadcast_to(np.zeros(1, np.uint8), (source.height, source.width, 3))
        polygons = [p for p in segmenter.polygons(Image(blank, source.path)) if p.area >= self.least[k]]
        self.messages += about(f"{SIDES[k]} regions", getattr(segmenter, "notes", []))
        return Stitched(polygons, np.zeros(len(polygons), bool), 0, 0)

    def _source_notes(self) -> list[str]:
        names = zip(SIDES, self.sources, strict=True)
        notes = [text for side, source in names for text in about(f"{side} image", source.notes)]
        return notes + (
            [] if self.given else list(dict.fromkeys(n for s in self.segmenters for n in getattr(s, "notes", [])))
        )


class _NoRegions:
    """A segmenter for tiles of which only the points are wanted."""

    name = "none"

    def segment(self, image: Image) -> list[Mask]:
        """None."""
        return []


def give_back_memory() -> None:
    """Tiles leave free memory in pieces, which the GNU C library keeps unless it is told; nothing happens elsewhere."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def _weights_only(progress: Progress) -> Progress:
    """Tells of weights on their way; all else would be a bar for each tile."""
    return lambda stage, share: progress(stage, share) if stage == "load" else None


def _equally_many(levels: list[list[Window]], others: Sequence[object]) -> list[list[Window]]:
    """The levels, with the first one repeated where the other photograph has more."""
    return [levels[0]] * (len(others) - len(levels)) + levels


def _has_data(image: Image) -> bool:
    return image.valid is None or bool(image.valid.mean() > 0.01)


def _can_be_segmented(image: Image) -> bool:
    return _has_data(image) and not thin(image.width, image.height)


def _square_enough(config: TilesConfig, sources: Sequence[Source]) -> TilesConfig:
    """Tiles no longer than a segmenter can see, where a photograph is thin; `InputError` where it is so thin that there
    is no view of all of it."""
    long_ones = [source for source in sources if thin(source.width, source.height)]
    for source in long_ones:
        width, height = source.width, source.height
        if min(width, height) < MIN_SIDE * max(1.0, math.sqrt(width * height) / OVERVIEW):
            raise InputError(
                f"{source.path or 'a photograph'} is {width} x {height} px, too long and thin: cut it in pieces"
            )
    shortest = min(min(source.width, source.height) for source in sources)
    return replace(config, size=min(config.size, THIN // 2 * shortest)) if long_ones else config


def _uncovered(window: Window, others: Sequence[Window]) -> float:
    """Share of a window that no other one covers, to a 32nd of its sides."""
    free: NDArray[np.bool_] = np.ones((32, 32), bool)
    x0, y0, x1, y1 = window
    step = np.array([x1 - x0, y1 - y0]) / 32
    for other in others:
        a, b, c, d = windows.common(window, other)
        if c > a and d > b:
            low = np.floor((np.array([a, b]) - [x0, y0]) / step + 0.01).astype(int)
            high = np.ceil((np.array([c, d]) - [x0, y0]) / step - 0.01).astype(int)
            free[low[1] : high[1], low[0] : high[0]] = False
    return float(free.mean())
