"""The part of a polygon that lies on one surface, found from its inside outwards.

Polygon diffusion approximation (paper 3.5.2, (1)) shrinks the whole polygon by one scale. If only part of the boundary
hangs over an edge, or over a hole of the mesh, that also shrinks the rest. Here the inside of the polygon is sampled on
a grid. Neighbouring samples are connected if the paper's constraints hold between them (both meet the surface, no jump,
no fold), and the largest connected part is kept. Its outline is the polygon's own, except where another surface begins.
If part of the surface hides another part, the samples on the hidden side of that edge are removed, so that the outline
does not run across the edge.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from zpm2.cloud.rays import Hits
from zpm2.cloud.scaling import sample_spacing
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import CloudConfig
from zpm2.polygons.repair import largest

Array = NDArray[np.float64]


def one_surface(
    shapes: Sequence[shapely.Polygon], view: SurfaceView, config: CloudConfig
) -> tuple[list[shapely.Polygon], Array]:
    """The largest connected part on one surface of each of n polygons (image px); empty if no ray meets the surface.

    Also returns (n,) the usual distance on the surface per px there, in units of the mesh; 0 if unknown.
    """
    grids = [_grid(shape, sample_spacing(shape, config)) for shape in shapes]
    points = np.concatenate([np.zeros((0, 2)), *(low + (at + 0.5) * step for at, low, step in grids)])
    hits = view.cast(points)
    distance = np.linalg.norm(hits.point - view.center, axis=1)
    result, spacings, start = [], np.zeros(len(shapes)), 0
    for k, (shape, (at, low, step)) in enumerate(zip(shapes, grids, strict=True)):
        rows = slice(start, start + len(at))
        start += len(at)
        good, gap = _connected(at, hits[rows], distance[rows], view.surface, config)
        result.append(_without_cells(shape, at[~good], low, step, config))
        spacings[k] = gap / step
    return result, spacings


def _grid(shape: shapely.Polygon, step: float) -> tuple[NDArray[np.int64], Array, float]:
    """(k, 2) columns and rows of the grid cells on or next to a polygon; the grid's corner and cell size, px."""
    low = np.array(shape.bounds[:2]) - step
    count = np.ceil((np.array(shape.bounds[2:]) + step - low) / step).astype(int)
    column, row = (part.ravel() for part in np.meshgrid(np.arange(count[0]), np.arange(count[1])))
    wide = shapely.buffer(shape, step / 2)
    shapely.prepare(wide)
    inside = shapely.contains_xy(wide, low[0] + (column + 0.5) * step, low[1] + (row + 0.5) * step)
    return np.c_[column[inside], row[inside]], low, step


def _connected(
    at: NDArray[np.int64], hits: Hits, distance: Array, surface: SurfaceMesh, config: CloudConfig
) -> tuple[NDArray[np.bool_], float]:
    """(k,) whether each cell is in the largest connected part; the median distance of neighbours on the surface."""
    face, point, met = hits.face, hits.point, hits.face >= 0
    if not met.any():
        return met, 0.0
    width = int(at[:, 0].max()) + 2
    index = np.full(width * (int(at[:, 1].max()) + 2), -1)
    key = at[:, 1] * width + at[:, 0]
    index[key] = np.arange(len(at))
    first = np.tile(np.arange(len(at)), 2)
    second = np.r_[index[key + 1], index[key + width]]
    links = np.flatnonzero((second >= 0) & met[first] & met[second])
    if len(links) == 0:
        return np.zeros(len(at), bool), 0.0
    first, second = first[links], second[links]
    gap = np.linalg.norm(point[first] - point[second], axis=1)
    usual = float(np.median(gap))
    bend = np.einsum("ni,ni->n", surface.normals[face[first]], surface.normals[face[second]])
    holds = (gap <= config.max_edge * usual) & (bend >= np.cos(np.radians(config.max_fold)))
    behind = np.where(distance[first] > distance[second], first, second)[~holds]
    met[behind] = False
    holds &= met[first] & met[second]
    first, second = first[holds], second[holds]
    _, label = connected_components(coo_array((np.ones(len(first)), (first, second)), shape=(len(at), len(at))))
    if not met.any():
        return met, usual
    return np.asarray(met & (label == np.bincount(label[met]).argmax())), usual


def without_discs(shape: shapely.Polygon, places: Array, radius: float, config: CloudConfig) -> shapely.Polygon:
    """Cuts discs of `radius` px around (k, 2) places on the boundary from a polygon, and returns the largest piece."""
    return _rounded(shape, shapely.buffer(shapely.multipoints(places), radius), radius, config)


def _without_cells(
    shape: shapely.Polygon, bad: NDArray[np.int64], low: Array, step: float, config: CloudConfig
) -> shapely.Polygon:
    """Cuts the grid cells `bad` (k, 2) from the polygon, rounds the cuts, and returns the largest piece."""
    if len(bad) == 0:
        return shape
    order = np.lexsort((bad[:, 0], bad[:, 1]))  # each run of cells in a row becomes one box
    x, y = bad[order].T
    begins = np.r_[True, (y[1:] != y[:-1]) | (x[1:] != x[:-1] + 1)]
    first, last = x[begins], x[np.r_[begins[1:], True]]
    row = y[begins]
    a, b = low[0] + first * step, low[0] + (last + 1) * step
    c, d = low[1] + row * step, low[1] + (row + 1) * step
    gone = shapely.union_all(shapely.box(a, c, b, d))
    return _rounded(shape, shapely.buffer(gone, step * config.cut_width / 2), step, config)


def _rounded(shape: shapely.Polygon, gone: shapely.Geometry, step: float, config: CloudConfig) -> shapely.Polygon:
    """Cuts the area `gone` and any thin pieces next to it from a polygon, and returns the largest piece."""
    width = step * config.cut_width
    left = shapely.difference(shape, gone)
    wide = shapely.buffer(shapely.buffer(left, -width), width)
    beside = shapely.buffer(gone, config.cut_neighborhood * width)
    thin = shapely.intersection(shapely.difference(left, wide), beside)
    part = largest(shapely.simplify(shapely.difference(left, thin), config.cut_simplify * step))
    holes = [hole for hole in part.interiors if shapely.Polygon(hole).area >= config.min_part_hole * shape.area]
    return shapely.Polygon(part.exterior, holes)
