"""The part of a polygon that lies on one surface, found by going outwards from its inside.

Polygon diffusion approximation (paper 3.5.2, (1)) looks for one scale of the whole polygon. Where only a part of the
boundary hangs over an edge, or over a hole of the mesh, one scale takes the rest away as well. Here the inside of the
polygon is sampled on a grid, neighbouring samples hang together where the paper's constraints hold between them (both
meet the surface, no jump, no fold), and of the largest connected part the outline stays: it is the polygon's own but
where another surface begins.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.surface import Surface
from zpm2.config import CloudConfig
from zpm2.model import PosedCamera

Array = NDArray[np.float64]
CELLS = 10_000  # samples of a polygon, about; larger polygons have a coarser grid
ROUND = 1.0  # steps: bays and capes of the cut that are narrower go
SMALL = 0.02  # of the area: smaller holes of the part do not count


def one_surface(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, options: CloudConfig
) -> list[shapely.Polygon]:
    """Of each polygon (image px) the largest part on one surface, in one piece; empty where nothing is met."""
    grids = [_grid(shape, options.step) for shape in shapes]
    points = np.concatenate([np.zeros((0, 2)), *(low + (at + 0.5) * step for at, low, step in grids)])
    origin = np.broadcast_to(view.center - surface.origin, (len(points), 3))
    hits = caster.first_hits(origin, view.directions(points))
    result, start = [], 0
    for shape, (at, low, step) in zip(shapes, grids, strict=True):
        rows = slice(start, start + len(at))
        start += len(at)
        good = _connected(at, hits, rows, surface, options)
        result.append(_without(shape, at[~good], low, step))
    return result


def _grid(shape: shapely.Polygon, least: float) -> tuple[NDArray[np.int64], Array, float]:
    """(k, 2) column and row of the cells on and just beside a polygon, the corner of the grid, and its step, px."""
    step = max(least, float(shape.area / CELLS) ** 0.5)
    low = np.array(shape.bounds[:2]) - step
    count = np.ceil((np.array(shape.bounds[2:]) + step - low) / step).astype(int)
    column, row = (part.ravel() for part in np.meshgrid(np.arange(count[0]), np.arange(count[1])))
    wide = shapely.buffer(shape, step / 2)
    shapely.prepare(wide)
    inside = shapely.contains_xy(wide, low[0] + (column + 0.5) * step, low[1] + (row + 0.5) * step)
    return np.c_[column[inside], row[inside]], low, step


def _connected(
    at: NDArray[np.int64], hits: Hits, rows: slice, surface: Surface, options: CloudConfig
) -> NDArray[np.bool_]:
    """(k,) which cells belong to the largest connected part."""
    face, point = hits.face[rows], hits.point[rows]
    if len(at) == 0:
        return np.zeros(0, bool)
    width = int(at[:, 0].max()) + 2
    index = np.full(width * (int(at[:, 1].max()) + 2), -1)
    key = at[:, 1] * width + at[:, 0]
    index[key] = np.arange(len(at))
    first = np.tile(np.arange(len(at)), 2)
    second = np.r_[index[key + 1], index[key + width]]
    there = second >= 0
    first, second = first[there], second[there]
    both = (face[first] >= 0) & (face[second] >= 0)
    first, second = first[both], second[both]
    gap = np.linalg.norm(point[first] - point[second], axis=1)
    bend = np.einsum("ni,ni->n", surface.normals[face[first]], surface.normals[face[second]])
    holds = (gap <= options.max_edge * np.median(gap)) if len(gap) else np.zeros(0, bool)
    holds &= bend >= np.cos(np.radians(options.max_fold))
    first, second = first[holds], second[holds]
    _, label = connected_components(coo_array((np.ones(len(first)), (first, second)), shape=(len(at), len(at))))
    met = face >= 0
    if not met.any():
        return met
    return np.asarray(met & (label == np.bincount(label[met]).argmax()))


def _without(shape: shapely.Polygon, bad: NDArray[np.int64], low: Array, step: float) -> shapely.Polygon:
    """The polygon without some cells of its grid, rounded, the largest piece."""
    if len(bad) == 0:
        return shape
    order = np.lexsort((bad[:, 0], bad[:, 1]))  # runs of cells of a row are one box each
    x, y = bad[order].T
    begins = np.r_[True, (y[1:] != y[:-1]) | (x[1:] != x[:-1] + 1)]
    first, last = x[begins], x[np.r_[begins[1:], True]]
    row = y[begins]
    a, b = low[0] + first * step, low[0] + (last + 1) * step
    c, d = low[1] + row * step, low[1] + (row + 1) * step
    gone = shapely.union_all(shapely.box(a, c, b, d))
    away = shapely.buffer(gone, step * ROUND / 2)
    left = shapely.difference(shape, away)
    left = shapely.buffer(shapely.buffer(left, -step * ROUND), step * ROUND)  # what is thinner goes
    left = shapely.simplify(shapely.intersection(left, shape), step / 4)
    parts = [part for part in shapely.get_parts(left) if part.geom_type == "Polygon"]
    if not parts:
        return shapely.Polygon()
    largest = max(parts, key=lambda part: part.area)
    holes = [hole for hole in largest.interiors if shapely.Polygon(hole).area >= SMALL * shape.area]
    return shapely.Polygon(largest.exterior, holes)
