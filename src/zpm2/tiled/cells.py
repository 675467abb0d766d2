"""Geometry cell by cell: a large scene has no single F and H, and no stage may look at all of it at once."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import Config, LocalConfig
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.model import PointMatches, PolygonArrays
from zpm2.polygons.warp import WarpedPolygons, warp_by_points

Array = NDArray[np.float64]
AROUND = 100  # points nearest to a cell that has fewer of its own
FARTHEST = 1.5  # cells, from the middle of one to the points that speak for it
NEIGHBORS = 8  # of a point, whose motion predicts its own
MOST = 2000  # points of a cell that its geometry is estimated from


@dataclass(frozen=True, eq=False)
class Cell:
    """Polygons of like place and size, and the geometry there."""

    rows: NDArray[np.int64]  # of the polygons
    reduction: int  # px of the photograph per px at which the polygons are compared
    initial: InitialGeometry  # of the points in and around the cell, px of the photographs


def cells(polygons: PolygonArrays, points: PointMatches, side: int, config: Config) -> Iterator[Cell]:
    """All polygons, by place and size: each reduced by a power of two, until its longer side has at most a quarter of
    `side` px, and those of one reduction in cells of `side` reduced px.

    A cell's geometry comes from the points within half a cell of it; where these are fewer than 100, from the 100
    nearest ones, but not from farther than a whole cell: what lies there says nothing about this place.
    """
    if len(polygons) == 0:
        return
    longer = (polygons.bounds[:, 2:] - polygons.bounds[:, :2]).max(1)
    reduction = 2 ** np.maximum(np.ceil(np.log2(np.maximum(longer, 1) / (side / 4))), 0).astype(np.int64)
    place = np.floor(polygons.centers / (side * reduction[:, None])).astype(np.int64)
    names, of = np.unique(np.c_[reduction, place], axis=0, return_inverse=True)
    tree = cKDTree(points.left) if len(points) else None
    order = np.argsort(of.ravel(), kind="stable")
    for name, rows in zip(names, np.split(order, np.cumsum(np.bincount(of.ravel()))[:-1]), strict=True):
        middle, reach = (name[1:] + 0.5) * side * name[0], side * name[0]
        near = np.zeros(0, np.int64)
        if tree is not None:
            near = np.array(sorted(tree.query_ball_point(middle, reach, p=np.inf)), np.int64)
            if len(near) < AROUND:
                _, near = tree.query(middle, k=AROUND, p=np.inf, distance_upper_bound=FARTHEST * reach)
                near = np.sort(near[near < len(points)])
        yield Cell(rows, int(name[0]), local_geometry(points[near], config))


def local_geometry(points: PointMatches, config: Config) -> InitialGeometry:
    """F and H of some points; where no homography holds for them, H is the affine map of most of them."""
    step = max(1, len(points) // MOST)
    initial = initial_geometry(points[np.arange(0, len(points), step)], config.global_match, config.seed)
    homography = initial.homography
    if isinstance(homography, Failed) and len(points) >= 3:
        cv2.setRNGSeed(config.seed)
        noise = 0.02 * max(1.0, float(np.ptp(points.left, axis=0).max()))
        matrix, _ = cv2.estimateAffine2D(points.left, points.right, method=cv2.RANSAC, ransacReprojThreshold=noise)
        if matrix is not None and np.isfinite(matrix).all() and abs(np.linalg.det(matrix[:, :2])) > 1e-6:
            homography = np.vstack([matrix, [0.0, 0.0, 1.0]])
    return replace(initial, homography=homography)


def uncertainty(initial: InitialGeometry) -> float:
    """px of the right photograph: nine of ten points lie no farther from where H and the motion that it does not
    explain, taken from their neighbours, lead; infinite for a few points."""
    points = initial.points[initial.consistent]
    if len(points) <= NEIGHBORS:
        return float("inf")
    motion = points.right - initial.prior_locations(points.left).centers
    _, near = cKDTree(points.left).query(points.left, k=NEIGHBORS + 1)
    away = np.linalg.norm(motion - np.median(motion[near[:, 1:]], axis=1), axis=1)
    return float(np.percentile(away, 90)) if np.isfinite(away).all() else float("inf")


def warped_by_cells(polygons: PolygonArrays, cells: Sequence[Cell], config: LocalConfig) -> WarpedPolygons:
    """All polygons in the other photograph, each by the geometry of its cell."""
    n = len(polygons)
    maps, own = np.tile(np.eye(3), (n, 1, 1)), np.zeros(n, np.int64)
    shapes = np.full(n, shapely.Polygon(), object)
    for cell in cells:
        part = warp_by_points(
            PolygonArrays([polygons.polygons[row] for row in cell.rows]), *cell.initial.forward(), config
        )
        maps[cell.rows], shapes[cell.rows], own[cell.rows] = part.maps, part.shapes, part.own
    return WarpedPolygons(maps, shapes, own)
