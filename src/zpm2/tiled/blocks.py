"""Matches at full size, block by block (paper 3.3 and 3.4).

Only the windows that show the polygons of a block are read, at the resolution that the polygons' size needs. One
assignment then decides over the possible matches of all blocks.

Time grows with the number of blocks, and so with the number of polygons, not with the size of the photographs. A block
is matched like a small pair: the search windows of the pyramid follow from the size of its images.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import Config, GlobalConfig, VisibleConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry, PriorLocations, locate, search_candidates
from zpm2.guided.prior import GuidedPrior
from zpm2.local_match import MatchProblem, one_to_one, possible_matches
from zpm2.model import PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.polygons.warp import WarpedPolygons
from zpm2.tiled import windows
from zpm2.tiled.cells import Cell, uncertainty
from zpm2.tiled.view import TileView, read_view, reduced_size
from zpm2.verify import verified

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LargePair:
    """Two photographs of any size, and their regions."""

    sources: tuple[Source, Source]
    polygons: tuple[PolygonArrays, PolygonArrays]
    guided: tuple[NDArray[np.bool_], NDArray[np.bool_]]  # (n,), (m,) found by prompting with the other photograph's


@dataclass(frozen=True, eq=False)
class _Block:
    """Polygons that are matched together, and the windows that show them."""

    views: tuple[TileView, TileView]
    initial: InitialGeometry  # px of the photographs
    rows: NDArray[np.int64]  # of the left polygons
    candidates: NDArray[np.int64]  # rows of the right polygons that may be their partners


def match_blocks(
    pair: LargePair,
    cells: Sequence[Cell],
    warped: WarpedPolygons,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
) -> list[PolygonMatch]:
    """One-to-one matches, by ascending left id. `cells` are those of the left polygons, `warped` the left polygons in
    the right photograph."""
    (left, right), sources = pair.polygons, pair.sources
    side, chosen = config.tiles.size, config.tiles.blocks
    places = shapely.bounds(warped.shapes).reshape(-1, 4)
    longer = [(bounds[:, 2:] - bounds[:, :2]).max(1, initial=0) for bounds in (places, right.bounds)]
    tree = shapely.STRtree(right.shapes)
    possible: list[PolygonMatch] = []
    for k, cell in enumerate(cells):
        reductions = cell.reduction, cell.reduction * _scale(left, warped, cell)
        search = config.global_match
        if search.search == "pyramid":
            error = uncertainty(cell.initial, config.tiles.cells) / reductions[1]
            search = replace(search, max_layers=layers(error, search))
        of_cell = replace(config, global_match=search)
        for rows, there in _spread(cell.rows, places, chosen.max_window * side * reductions[1]):
            target = _window(there, chosen.margin * reductions[1], sources[1])
            if windows.area(target) == 0:
                continue
            candidates = np.sort(tree.query(shapely.box(*target), predicate="intersects"))
            ratio = chosen.max_size_ratio
            shortest, longest = longer[0][rows].min() / ratio, longer[0][rows].max() * ratio
            candidates = candidates[(longer[1][candidates] >= shortest) & (longer[1][candidates] <= longest)]
            if len(candidates) == 0:
                continue
            own = _window(_extent(left.bounds[rows]), chosen.margin * reductions[0], sources[0])
            views = (
                read_view(sources[0], own, reduced_size(own, reductions[0])),
                read_view(sources[1], target, reduced_size(target, reductions[1])),
            )
            possible += _possible(_Block(views, cell.initial, rows, candidates), pair, warped, of_cell)
        progress((k + 1) / len(cells))
    return one_to_one(possible, config.local_match)


def layers(error: float, config: GlobalConfig) -> int:
    """How many layers the pyramid needs, so that the first search window reaches `error` px in the block's right image.

    If neighbours predict the location of a polygon well, few layers do: the search begins near the location.
    """
    reach, count = config.tau - config.phi / 2, 1
    while reach < error and count < config.max_layers:
        reach, count = reach * config.factor, count + 1
    return count


def _scale(left: PolygonArrays, warped: WarpedPolygons, cell: Cell) -> float:
    """Right px per left px; at least 1, so that the coarser photograph is not enlarged."""
    area = shapely.area(warped.shapes[cell.rows])
    some = area > 0
    if not some.any():
        return 1.0
    return max(1.0, float(np.median(np.sqrt(area[some] / left.areas[cell.rows][some]))))


def _spread(rows: NDArray[np.int64], places: Array, max_side: float) -> list[tuple[NDArray[np.int64], Array]]:
    """Groups of polygons with the extent (4,) of their predicted places in the right photograph.

    Polygons without a place are left out. If relief or wrong points scatter the places, they are split into groups of
    at most `max_side` px. A polygon whose own place is wider than half of that is left out: the map is near its horizon
    there.
    """
    rows = rows[np.isfinite(places[rows]).all(1)]
    rows = rows[(places[rows, 2:] - places[rows, :2]).max(1, initial=0) <= max_side / 2]
    if len(rows) == 0:
        return []
    extent = _extent(places[rows])
    if (extent[2:] - extent[:2]).max() <= max_side:
        return [(rows, extent)]
    middle = (places[rows, :2] + places[rows, 2:]) / 2
    _, part = np.unique(np.floor(middle / (max_side / 2)).astype(np.int64), axis=0, return_inverse=True)
    parts = [rows[part.ravel() == k] for k in range(int(part.max()) + 1)]
    return [(some, _extent(places[some])) for some in parts]


def _possible(block: _Block, pair: LargePair, warped: WarpedPolygons, config: Config) -> list[PolygonMatch]:
    """The possible matches of a block."""
    views, rows, candidate_rows = block.views, block.rows, block.candidates
    to_view = [each.from_px for each in views]
    left, right = (
        PolygonArrays([_moved(arrays.polygons[row], matrix) for row in some])
        for arrays, some, matrix in zip(pair.polygons, (rows, candidate_rows), to_view, strict=True)
    )
    initial, guided_prior = _reduced(block.initial, to_view), None
    maps = to_view[1] @ warped.maps[rows] @ views[0].to_px
    if config.guided.direction != "off":
        shapes = shapely.transform(warped.shapes[rows], lambda xy: _apply(to_view[1], xy))
        guided = pair.guided[0][rows], pair.guided[1][candidate_rows]
        guided_prior = GuidedPrior(
            WarpedPolygons(maps, shapes, warped.own[rows]),
            (~guided[0], ~guided[1]),
            guided,
            config.guided,
        )
    images = views[0].image, views[1].image
    prior = PriorLocations(*geometry.linearised(maps, left.centers))  # from the points around each, not one H
    locations = locate(*images, left.centers, initial, config.global_match, prior)
    candidates = search_candidates(left, right, locations, config.global_match)
    problem = MatchProblem(images, (left, right), initial, locations, candidates, guided_prior)
    # the views end where the block does, which cuts no polygon off
    local = replace(config.local_match, visible=VisibleConfig(on=False))
    possible = possible_matches(problem, local)
    return verified(problem, possible, one_to_one(possible, local), local)


def _reduced(initial: InitialGeometry, to_view: Sequence[Array]) -> InitialGeometry:
    """The geometry, converted to px of the views."""
    points = initial.points
    moved = PointMatches(_apply(to_view[0], points.left), _apply(to_view[1], points.right), points.score)
    fundamental, homography = initial.fundamental, initial.homography
    back = np.linalg.inv(to_view[0])
    if not isinstance(fundamental, Failed):
        fundamental = np.linalg.inv(to_view[1]).T @ fundamental @ back
        fundamental = fundamental / np.linalg.norm(fundamental)
    if not isinstance(homography, Failed):
        homography = to_view[1] @ homography @ back
        homography = homography / abs(homography[2, 2])
    return replace(initial, points=moved, fundamental=fundamental, homography=homography)


def _moved(polygon: Polygon, to_view: Array) -> Polygon:
    return replace(
        polygon,
        exterior=_apply(to_view, polygon.exterior),
        holes=tuple(_apply(to_view, hole) for hole in polygon.holes),
    )


def _apply(matrix: Array, points: Array) -> Array:
    """(n, 2) points through an upright similarity (3, 3)."""
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])


def _extent(bounds: Array) -> Array:
    return np.concatenate([bounds[:, :2].min(0), bounds[:, 2:].max(0)])


def _window(extent: Array, margin: float, source: Source) -> Window:
    x0, y0, x1, y1 = np.concatenate([np.floor(extent[:2] - margin), np.ceil(extent[2:] + margin)]).astype(int)
    return windows.common((int(x0), int(y0), int(x1), int(y1)), (0, 0, source.width, source.height))
