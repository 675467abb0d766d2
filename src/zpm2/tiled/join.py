"""Joins tiles: the points of all tiles, and the regions of each photograph without seams."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import Config
from zpm2.features.combined import distinct
from zpm2.model import Image, PointMatches, Polygon
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.segment.answers import polygons_of
from zpm2.segment.protocol import PolygonSource
from zpm2.tiled import windows
from zpm2.tiled.predict import coherent_points
from zpm2.tiled.stitch import RegionPieces, StitchedRegions, cut_by_window, stitch
from zpm2.tiled.tile import Tile

Flags = tuple[NDArray[np.bool_], NDArray[np.bool_]]  # of the left and the right regions of a tile


def join_points(tiles: Sequence[Tile], config: Config) -> PointMatches:
    """The points of the finest tiles, and those of coarser tiles where there are no finer ones nearby."""
    chosen = config.tiles
    points = PointMatches.empty()
    for level in sorted({tile.level for tile in tiles}, reverse=True):
        of_level = [tile for tile in tiles if tile.level == level]
        side = max((windows.side(tile.windows[0]) for tile in of_level if tile.windows[0] is not None), default=0)
        joined = PointMatches.join([tile.points for tile in of_level])
        more = coherent_points(joined, chosen.partner.noise * side, chosen.partner)
        if len(points) and len(more):
            away, _ = cKDTree(points.left).query(more.left)
            more = more[away > chosen.coarse_distance * chosen.size]
        points = PointMatches.join([points, more])
    return points[distinct(points, chosen.merge_px)] if len(points) else points


def join_regions(
    tiles: Sequence[Tile], sources: Sequence[Source], min_areas: Sequence[float], config: Config
) -> tuple[StitchedRegions, StitchedRegions]:
    """The regions of the left and the right photograph, of at least `min_areas` px^2."""
    cut = [_cut(tile, sources, config) for tile in tiles]
    left, right = (_stitched(tiles, cut, k, sources[k], min_areas[k], config) for k in range(2))
    return left, right


def given_regions(segmenter: PolygonSource, source: Source, min_area: float) -> StitchedRegions:
    """Regions that the user gave; no tile cuts them."""
    blank = np.broadcast_to(np.zeros(1, np.uint8), (source.height, source.width, 3))
    polygons = [p for p in polygons_of(segmenter, Image(blank, source.path, geo=source.geo)) if p.area >= min_area]
    return StitchedRegions(polygons, np.zeros(len(polygons), bool), 0, 0)


def _cut(tile: Tile, sources: Sequence[Source], config: Config) -> Flags:
    """Whether each left and each right region of a tile is cut by the tile's border."""
    left, right = (
        np.zeros(len(polygons), bool)
        if window is None
        else cut_by_window(polygons, window, (source.width, source.height), config.tiles.stitch)
        for polygons, window, source in zip(tile.polygons, tile.windows, sources, strict=True)
    )
    i, j = tile.guided.T
    either = left[i] | right[j]  # a region found by prompting with a cut one counts as cut, too
    left[i], right[j] = either, either
    return left, right


def _stitched(
    tiles: Sequence[Tile], cut: Sequence[Flags], k: int, source: Source, min_area: float, config: Config
) -> StitchedRegions:
    """The regions of the left (`k` 0) or the right (1) photograph."""
    polygons: list[Polygon] = []
    read: list[Window] = []
    number, guided, flags, level = [], [], [], []
    for tile, ends in zip(tiles, cut, strict=True):
        window = tile.windows[k]
        if window is None:
            continue
        prompted = np.zeros(len(tile.polygons[k]), bool)
        prompted[tile.guided[:, k]] = True
        number.append(np.full(len(tile.polygons[k]), len(read)))
        polygons += tile.polygons[k]
        guided.append(prompted)
        flags.append(ends[k])
        read.append(window)
        level.append(tile.level)
    pieces = RegionPieces(
        polygons,
        np.concatenate(number).astype(np.int64),
        np.concatenate(flags),
        np.concatenate(guided),
        read,
        np.array(level),
    )
    return stitch(pieces, (source.width, source.height), config, min_area)
