"""Geometry cell by cell: no single F and H describe a large scene, and no stage keeps all of it in memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import CellsConfig, Config, LocalConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons.warp import WarpedPolygons, warp_by_points
from zpm2.tiled.predict import MIN_DETERMINANT

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cell:
    """Polygons of similar size in one part of the photograph, and the geometry there."""

    rows: NDArray[np.int64]  # of the polygons
    reduction: int  # px of the photograph per px at which the polygons are compared
    initial: InitialGeometry  # of the points in and around the cell, px of the photographs


def cells(polygons: PolygonArrays, points: PointMatches, config: Config) -> Iterator[Cell]:
    """Groups all polygons into cells by size and place.

    Each polygon is reduced by a power of two, until its longer side is at most a share (`polygons_across`) of
    `config.tiles.size` px. Polygons with the same reduction form cells of `config.tiles.size` reduced px.

    The geometry of a cell is estimated from the points in it and within half a cell around it. If these are fewer than
    `min_points`, the nearest points are added up to that number, but none beyond `max_distance`: points farther away
    tell nothing about this place.
    """
    side, chosen = config.tiles.size, config.tiles.cells
    if len(polygons) == 0:
        return
    longer = (polygons.bounds[:, 2:] - polygons.bounds[:, :2]).max(1)
    reduction = 2 ** np.maximum(np.ceil(np.log2(np.maximum(longer, 1) / (side / chosen.polygons_across))), 0).astype(
        np.int64
    )
    place = np.floor(polygons.centers / (side * reduction[:, None])).astype(np.int64)
    names, of = np.unique(np.c_[reduction, place], axis=0, return_inverse=True)
    tree = cKDTree(points.left) if len(points) else None
    order = np.argsort(of.ravel(), kind="stable")
    for name, rows in zip(names, np.split(order, np.cumsum(np.bincount(of.ravel()))[:-1]), strict=True):
        middle, reach = (name[1:] + 0.5) * side * name[0], side * name[0]
        near = np.zeros(0, np.int64)
        if tree is not None:
            near = np.array(sorted(tree.query_ball_point(middle, reach, p=np.inf)), np.int64)
            if len(near) < chosen.min_points:
                farthest = chosen.max_distance * reach
                _, near = tree.query(middle, k=chosen.min_points, p=np.inf, distance_upper_bound=farthest)
                near = np.sort(near[near < len(points)])
        yield Cell(rows, int(name[0]), local_geometry(points[near], config))


def local_geometry(points: PointMatches, config: Config) -> InitialGeometry:
    """F and H of some points. If no homography fits them, H is the affine map that fits most of them."""
    chosen = config.tiles.cells
    step = max(1, len(points) // chosen.max_points)
    initial = initial_geometry(points[np.arange(0, len(points), step)], config.global_match, config.seed)
    homography = initial.homography
    if isinstance(homography, Failed) and len(points) >= 3:
        cv2.setRNGSeed(config.seed)
        noise = chosen.affine_noise * max(1.0, float(np.ptp(points.left, axis=0).max()))
        matrix, _ = cv2.estimateAffine2D(points.left, points.right, method=cv2.RANSAC, ransacReprojThreshold=noise)
        if matrix is not None and np.isfinite(matrix).all() and abs(np.linalg.det(matrix[:, :2])) > MIN_DETERMINANT:
            homography = np.vstack([matrix, [0.0, 0.0, 1.0]])
    return replace(initial, homography=homography)


def uncertainty(initial: InitialGeometry, config: CellsConfig) -> float:
    """How well the points predict locations, in px of the right photograph; infinite if there are only a few points.

    Each point is predicted by H and the median residual of its neighbours. A share of `predicted` of the points lies at
    most this far from the prediction.
    """
    points = initial.points[initial.consistent]
    if len(points) <= config.neighbors:
        return float("inf")
    motion = points.right - initial.prior_locations(points.left).centers
    _, near = cKDTree(points.left).query(points.left, k=config.neighbors + 1)
    away = np.linalg.norm(motion - np.median(motion[near[:, 1:]], axis=1), axis=1)
    return float(np.percentile(away, 100 * config.predicted)) if np.isfinite(away).all() else float("inf")


def warped_by_cells(polygons: PolygonArrays, cells: Sequence[Cell], config: LocalConfig) -> WarpedPolygons:
    """All polygons, warped into the other photograph, each by the geometry of its cell."""
    n = len(polygons)
    maps, own = np.tile(np.eye(3), (n, 1, 1)), np.zeros(n, np.int64)
    shapes = np.full(n, shapely.Polygon(), object)
    for cell in cells:
        part = warp_by_points(
            PolygonArrays([polygons.polygons[row] for row in cell.rows]), *cell.initial.forward(), config
        )
        maps[cell.rows], shapes[cell.rows], own[cell.rows] = part.maps, part.shapes, part.own
    return WarpedPolygons(maps, shapes, own)
