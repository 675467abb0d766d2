"""From two large photographs to tiles: level by level, from an overview down to full resolution.

The points of the level above predict the right window of each left tile. `PairMatcher` then matches the two like any
pair of photographs (points, guided detection).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.config import Config
from zpm2.features import PointMatcher
from zpm2.model import Image, Mask, PointMatches, thin
from zpm2.photos.checks import MIN_SIDE
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.pipeline import PairMatcher
from zpm2.runtime import Progress, StageTimer
from zpm2.segment.protocol import Segmenter
from zpm2.tiled import windows
from zpm2.tiled.predict import (
    PartnerWindow,
    affine_by_georeference,
    affine_map,
    coherent_points,
    partner_window,
    square_view,
)
from zpm2.tiled.tile import SIDES, Tile, TileCache, TilePart, Windows, tile_of_pair, tile_without_partner
from zpm2.tiled.view import TileView, applied_turn, read_view, reduced_size


@dataclass(eq=False)
class TileMatcher:
    """The regions and points of a pair, tile by tile."""

    sources: tuple[Source, Source]
    config: Config
    segmenters: tuple[Segmenter, Segmenter] | None  # None: regions are given, only points are wanted
    points: PointMatcher | None  # replaces the configured one
    progress: Progress
    timer: StageTimer
    cache: TileCache
    make_elsewhere: Callable[[Sequence[TilePart]], None] | None = None  # in other processes, into the cache

    def __post_init__(self) -> None:
        config, quiet = self.config, weights_only(self.progress)
        min_area = min(config.tiles.min_region, config.segment.min_area)
        of_tile = replace(
            config,
            segment=replace(config.segment, min_area=min_area, detail=replace(config.segment.detail, level="off")),
            max_memory=memory.UNLIMITED,  # the whole pair was checked before
        )
        segmenter = self.segmenters or _NoRegions()
        self._whole = PairMatcher(of_tile, segmenter=segmenter, points=self.points, progress=quiet)
        escalate = replace(of_tile.points.escalate, on=False)
        once = replace(of_tile, points=replace(of_tile.points, escalate=escalate))
        self._tile = PairMatcher(once, segmenter=segmenter, points=self.points, progress=quiet)
        longest = max(max(source.width, source.height) for source in self.sources)
        full_size = replace(once, points=replace(once.points, max_size=longest))
        self._points_only = PairMatcher(full_size, segmenter=_NoRegions(), points=self.points, progress=quiet)

    def tiles(self) -> list[Tile]:
        """All tiles, coarsest level first."""
        left, right = self.sources
        layout, other = (windows.levels(source.width, source.height, self.config.tiles) for source in (left, right))
        layout, other = _equally_many(layout, other), _equally_many(other, layout)
        total = sum(map(len, layout))
        found: list[Tile] = []
        points = PointMatches.empty()
        for level, level_windows in enumerate(layout):
            parts = [
                self._part(level, n, window, self._partner(level, window, points))
                for n, window in enumerate(level_windows)
            ]
            if level and self.config.tiles.outside and self.segmenters is not None:
                parts += self._unseen(level, [part.windows[1] for part in parts], other[level], len(level_windows))
            missing = [part for part in parts if not self.cache.has(part.name)]
            if self.make_elsewhere is not None and len(missing) > 1:
                with self.timer("tiles"):
                    self.make_elsewhere(missing)
                self.cache.reused -= sum(self.cache.has(part.name) for part in missing)
            here: list[Tile] = []
            for part in parts:
                self.progress("tiles", min(1.0, (len(found) + len(here)) / total))
                here.append(self.tile(part))
            found += here
            chosen = self.config.tiles.partner
            fresh = PointMatches.join([tile.points for tile in here])
            fresh = coherent_points(fresh, chosen.noise * windows.side(level_windows[0]), chosen)
            points = fresh if len(fresh) else points
        self.progress("tiles", 1.0)
        return found

    def _partner(self, level: int, window: Window, points: PointMatches) -> PartnerWindow | None:
        """The right window for a left one, from the points of the level above.

        Without points, from the georeferences, which may be wrong by part of a tile. The whole left photograph is
        compared with the whole right one, unless the right one is known to show much more.
        """
        left, right = self.sources
        tiles, chosen = self.config.tiles, self.config.tiles.partner
        size = right.width, right.height
        noise = chosen.noise * windows.side(window)
        matrix = affine_map(points, window, noise, chosen, self.config.seed) if level else None
        if matrix is not None:
            found = partner_window(window, matrix, points, size, tiles.overlap, chosen)
        else:
            matrix = affine_by_georeference(window, left, right, chosen)
            found = partner_window(window, matrix, points, size, chosen.georeference_margin, chosen)
        if level == 0:
            if found is None or windows.area(found.window) > chosen.max_first_share * right.width * right.height:
                return PartnerWindow((0, 0, *size), max(size) / max(left.width, left.height), 0.0)
        elif found is not None:
            width, height = found.window[2] - found.window[0], found.window[3] - found.window[1]
            shortest = min(chosen.min_side, min(self._view_size(window)) / 2)
            if min(width, height) < shortest * self._reduction(window) * max(1.0, found.scale):
                return None
        return found

    def _part(self, level: int, number: int, window: Window, partner: PartnerWindow | None) -> TilePart:
        """A left window and its partner."""
        if partner is None:
            return TilePart(level, number, (window, None))
        right = self.sources[1].width, self.sources[1].height
        if level == 0:
            target, size = partner.window, self._view_size(partner.window)
        else:
            target, size = square_view(partner, self._reduction(window), right, self.config.tiles)
        turn = 0.0 if thin(*size) else applied_turn(-partner.turn, self.config.tiles)
        return TilePart(level, number, (window, target), size, turn)

    def tile(self, part: TilePart) -> Tile:
        """The tile of an earlier run, or else matched now and stored."""
        tile = self.cache.load(part.name, part.windows)
        if tile is None:
            tile = self._matched(part)
            for stage, seconds in tile.seconds.items():
                self.timer.seconds[stage] = self.timer.seconds.get(stage, 0.0) + seconds
            self.cache.save(part.name, tile)
            memory.give_back()
        return tile

    def _matched(self, part: TilePart) -> Tile:
        sides = zip(self.sources, part.windows, (None, part.size), (0.0, part.turn), strict=True)
        with self.timer("read"):
            views = [
                None if window is None else read_view(source, window, size or self._view_size(window), turn)
                for source, window, size, turn in sides
            ]
        left, right = views
        if left is None or right is None:
            return self._separate(part.level, part.windows, views)
        return self._pair(part.level, part.windows, (left, right))

    def _pair(self, level: int, both: Windows, views: tuple[TileView, TileView]) -> Tile:
        images = views[0].image, views[1].image
        if not all(self._has_data(image) and min(image.width, image.height) >= MIN_SIDE for image in images):
            return self._separate(level, both, views)
        matcher = self._tile if level else self._whole
        if (both[0] and self._narrow(both[0])) or any(thin(image.width, image.height) for image in images):
            matcher = self._points_only
        return tile_of_pair(level, both, views, matcher(*images))

    def _separate(self, level: int, both: Windows, views: Sequence[TileView | None]) -> Tile:
        """The regions of windows that have nothing in common, where they are wanted."""
        start, found = perf_counter(), []
        wanted = self.config.tiles.outside and self.segmenters is not None
        for k, view in enumerate(views):
            segmented = wanted and view is not None and self._can_be_segmented(view.image)
            found.append((view, self._tile.regions(view.image, SIDES[k])) if segmented and view is not None else None)
        return tile_without_partner(level, both, found, perf_counter() - start)

    def _unseen(self, level: int, seen: Sequence[Window | None], own: Sequence[Window], number: int) -> list[TilePart]:
        """Parts for the right photograph's windows at that level that no left tile was compared with."""
        covered = [window for window in seen if window is not None]
        tiles = self.config.tiles
        alone = [window for window in own if _uncovered(window, covered, tiles.cover_cells) >= tiles.min_unseen]
        return [TilePart(level, number + k, (None, window)) for k, window in enumerate(alone)]

    def _view_size(self, window: Window) -> tuple[int, int]:
        """(width, height) px of the view of a window."""
        return reduced_size(window, self._reduction(window))

    def _reduction(self, window: Window) -> float:
        """px of the photograph per px of the view, which is as long as a tile. A narrow window is searched for points
        only: its view has as many px as an overview."""
        if self._narrow(window):
            return max(1.0, math.sqrt(windows.area(window)) / self.config.tiles.overview)
        return self._to_tile(window)

    def _to_tile(self, window: Window) -> float:
        """px of the photograph per px of a view that is as long as a tile."""
        return max(1.0, windows.side(window) / self.config.tiles.size)

    def _narrow(self, window: Window) -> bool:
        """Whether a window is thin, or too thin to be seen in a view that is as long as a tile."""
        sides = window[2] - window[0], window[3] - window[1]
        return thin(*sides) or min(reduced_size(window, self._to_tile(window))) < MIN_SIDE

    def _has_data(self, image: Image) -> bool:
        return image.valid is None or bool(image.valid.mean() > self.config.tiles.min_data)

    def _can_be_segmented(self, image: Image) -> bool:
        return self._has_data(image) and not thin(image.width, image.height)


class _NoRegions:
    """A segmenter for tiles that only need points."""

    name = "none"

    def segment(self, image: Image) -> list[Mask]:
        """None."""
        return []


def weights_only(progress: Progress) -> Progress:
    """Reports only downloads of weights: other stages would show a progress bar for each tile."""
    return lambda stage, share: progress(stage, share) if stage == "load" else None


def _equally_many(levels: list[list[Window]], others: Sequence[object]) -> list[list[Window]]:
    """The levels, with the first one repeated where the other photograph has more."""
    return [levels[0]] * (len(others) - len(levels)) + levels


def _uncovered(window: Window, others: Sequence[Window], cells: int) -> float:
    """Share of a window that none of the others covers, counted on a grid of `cells` x `cells`."""
    free: NDArray[np.bool_] = np.ones((cells, cells), bool)
    x0, y0, x1, y1 = window
    step = np.array([x1 - x0, y1 - y0]) / cells
    for other in others:
        a, b, c, d = windows.common(window, other)
        if c > a and d > b:
            low = np.floor((np.array([a, b]) - [x0, y0]) / step + 0.01).astype(int)
            high = np.ceil((np.array([c, d]) - [x0, y0]) / step - 0.01).astype(int)
            free[low[1] : high[1], low[0] : high[0]] = False
    return float(free.mean())
