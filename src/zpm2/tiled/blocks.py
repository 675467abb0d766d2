"""Matching at full size, block by block: only the windows that a block's polygons need are read, at the resolution that
their size needs, and one assignment decides over all blocks (paper 3.3 and 3.4).

Time grows with the number of blocks, hence of polygons, not with the pixels of the photographs. In a block everything
is as in a small pair: the search windows of the pyramid follow from the size of the block's images.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import Config, GlobalConfig
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
from zpm2.tiled.view import View, reduced_size, view

Array = NDArray[np.float64]
MARGIN = 64  # reduced px around a block's polygons: the search windows of the finest levels
SIZE_RATIO = 4.0  # of two polygons' longer sides, beyond which they are not compared
MOST = 1.5  # sides of a cell, the largest window that is read for a block


def match_blocks(
    sources: tuple[Source, Source],
    polygons: tuple[PolygonArrays, PolygonArrays],
    guided: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    cells: Sequence[Cell],
    warped: WarpedPolygons,
    side: int,
    config: Config,
    progress: Callable[[float], None] = lambda _: None,
) -> list[PolygonMatch]:
    """One-to-one matches, by ascending left id. `cells` are those of the left polygons and `side` px theirs, `warped`
    the left polygons in the right photograph."""
    left, right = polygons
    places = shapely.bounds(warped.shapes).reshape(-1, 4)
    longer = [(bounds[:, 2:] - bounds[:, :2]).max(1, initial=0) for bounds in (places, right.bounds)]
    tree = shapely.STRtree(right.shapes)
    possible: list[PolygonMatch] = []
    for k, cell in enumerate(cells):
        reductions = cell.reduction, cell.reduction * _scale(left, warped, cell)
        search = config.global_match
        if search.search == "pyramid":
            search = replace(search, max_layers=layers(uncertainty(cell.initial) / reductions[1], search))
        chosen = replace(config, global_match=search)
        for rows, there in _spread(cell.rows, places, MOST * side * reductions[1]):
            target = _window(there, MARGIN * reductions[1], sources[1])
            if windows.area(target) == 0:
                continue
            partners = np.sort(tree.query(shapely.box(*target), predicate="intersects"))
            least, most = longer[0][rows].min() / SIZE_RATIO, longer[0][rows].max() * SIZE_RATIO
            partners = partners[(longer[1][partners] >= least) & (longer[1][partners] <= most)]
            if len(partners) == 0:
                continue
            own = _window(_extent(left.bounds[rows]), MARGIN * reductions[0], sources[0])
            views = (
                view(sources[0], own, reduced_size(own, reductions[0])),
                view(sources[1], target, reduced_size(target, reductions[1])),
            )
            possible += _block(views, polygons, guided, cell.initial, warped, rows, partners, chosen)
        progress((k + 1) / len(cells))
    return one_to_one(possible, config.local_match)


def layers(error: float, config: GlobalConfig) -> int:
    """Of the pyramid, so many that the first search window reaches `error` px of the block's right image: where
    neighbours say well where a polygon is, the search begins near to it."""
    reach, count = config.tau - config.phi / 2, 1
    while reach < error and count < config.max_layers:
        reach, count = reach * config.factor, count + 1
    return count


def _scale(left: PolygonArrays, warped: WarpedPolygons, cell: Cell) -> float:
    """Right px per left px, at least 1: the coarser photograph is not enlarged."""
    area = shapely.area(warped.shapes[cell.rows])
    some = area > 0
    if not some.any():
        return 1.0
    return max(1.0, float(np.median(np.sqrt(area[some] / left.areas[cell.rows][some]))))


def _spread(rows: NDArray[np.int64], places: Array, most: float) -> list[tuple[NDArray[np.int64], Array]]:
    """Those of the polygons that have a place in the right photograph, and the extent (4,) of these places; in parts of
    at most `most` px, where relief or wrong points scatter them. A place that is half as wide by itself is none: a map
    that is near its horizon there."""
    rows = rows[np.isfinite(places[rows]).all(1)]
    rows = rows[(places[rows, 2:] - places[rows, :2]).max(1, initial=0) <= most / 2]
    if len(rows) == 0:
        return []
    extent = _extent(places[rows])
    if (extent[2:] - extent[:2]).max() <= most:
        return [(rows, extent)]
    middle = (places[rows, :2] + places[rows, 2:]) / 2
    _, part = np.unique(np.floor(middle / (most / 2)).astype(np.int64), axis=0, return_inverse=True)
    parts = [rows[part.ravel() == k] for k in range(int(part.max()) + 1)]
    return [(some, _extent(places[some])) for some in parts]


def _block(
    views: tuple[View, View],
    polygons: tuple[PolygonArrays, PolygonArrays],
    guided: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    initial: InitialGeometry,
    warped: WarpedPolygons,
    rows: NDArray[np.int64],
    partners: NDArray[np.int64],
    config: Config,
) -> list[PolygonMatch]:
    """The possible matches of the left polygons `rows` and the right ones `partners`."""
    to_view = [each.from_px for each in views]
    left, right = (
        PolygonArrays([_moved(arrays.polygons[row], matrix) for row in some])
        for arrays, some, matrix in zip(polygons, (rows, partners), to_view, strict=True)
    )
    initial, guided_prior = _reduced(initial, to_view), None
    maps = to_view[1] @ warped.maps[rows] @ views[0].to_px
    if config.guided.direction != "off":
        shapes = shapely.transform(warped.shapes[rows], lambda xy: _apply(to_view[1], xy))
        asked = guided[0][rows], guided[1][partners]
        guided_prior = GuidedPrior(
            WarpedPolygons(maps, shapes, warped.own[rows]),
            (~asked[0], ~asked[1]),
            asked,
            config.guided,
        )
    images = views[0].image, views[1].image
    prior = PriorLocations(*geometry.linearised(maps, left.centers))  # by the points around each, not one H for all
    locations = locate(*images, left.centers, initial, config.global_match, prior)
    candidates = search_candidates(left, right, locations, config.global_match)
    problem = MatchProblem(images, (left, right), initial, locations, candidates, guided_prior)
    return possible_matches(problem, config.local_match)


def _reduced(initial: InitialGeometry, to_view: Sequence[Array]) -> InitialGeometry:
    """The geometry in px of the views."""
    points = initial.points
    moved = PointMatches(_apply(to_view[0], points.left), _apply(to_view[1], points.right), points.score)
    fundamental, homography = initial.fundamental, initial.homography
    back = np.linalg.inv(to_view[0])
    if not isinstance(fundamental, Failed):
        fundamental = np.linalg.inv(to_view[1]).T @ fundamental @ back
        fundamental = fundamental / np.linalg.norm(fundamental)
    if not isinstance(homography, Failed):
        homography = to_view[1] @ homography @ back
        homography = homography / homography[2, 2]
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
