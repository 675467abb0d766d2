"""Tiles made by other processes: what they need to know, and what they do.

The tiles of a level do not depend on each other. Processes write them into the folder of finished tiles, where the run
finds them as those of an earlier run. So a result has the same bytes, whoever made its tiles.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from zpm2.config import Config
from zpm2.photos.source import opened
from zpm2.pipeline import PairMatcher
from zpm2.runtime import StageTimer
from zpm2.tiled.tile import TileCache, TilePart
from zpm2.tiled.tile_matcher import TileMatcher


@dataclass(frozen=True)
class TileOrder:
    """All that the tiles of a pair have in common."""

    photographs: tuple[str, str]  # files that each process can read
    config: Config
    given: bool  # whether regions are given, so that tiles need only points
    folder: str  # of finished tiles, which each process can write


class TileWorkers(Protocol):
    """Processes that make tiles."""

    def make(self, order: TileOrder, parts: Sequence[TilePart], say: Callable[[str], None]) -> None:
        """Makes these tiles. One that cannot be made is left out, and `say` is told why."""
        ...


class TileMaker:
    """Makes the tiles of one pair after the other in this process. Photographs and networks stay open for the next tile
    of the same order. Errors are those of `Matcher`."""

    def __init__(self) -> None:
        self._order: TileOrder | None = None
        self._finder: TileMatcher | None = None
        self._open = ExitStack()

    def make(self, order: TileOrder, part: TilePart) -> float:
        """Makes a tile, unless it is there; returns its seconds."""
        if self._finder is None or order != self._order:
            self._open.close()
            self._order, self._finder = order, self._opened(order)
        return sum(self._finder.tile(part).seconds.values())

    def _opened(self, order: TileOrder) -> TileMatcher:
        config, folder = order.config, Path(order.folder)
        sources = self._open.enter_context(opened(*order.photographs, config.raster))
        segmenters = None if order.given else PairMatcher(config).segmenters()

        def quiet(stage: str, share: float) -> None:
            pass

        cache = TileCache(folder.parent, folder.name)
        return TileMatcher(sources, config, segmenters, None, quiet, StageTimer(quiet), cache)
