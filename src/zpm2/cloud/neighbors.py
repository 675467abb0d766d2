"""Which views are worth matching with each other."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.coverage import UNSEEN
from zpm2.cloud.rays import RayCaster
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import CloudConfig
from zpm2.errors import InputError
from zpm2.geometry import sight_angles
from zpm2.model import PosedCamera

Array = NDArray[np.float64]


def neighbor_pairs(
    cameras: Sequence[PosedCamera], surface: SurfaceMesh, caster: RayCaster, config: CloudConfig
) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of each view with the `neighbors` best other views.

    The score of another view is the share of this view's surface points that it sees, times
    1 - angle / `max_neighbor_angle`, where angle is the median angle between their lines of sight. `InputError` if no
    view sees the surface.
    """
    views = [SurfaceView(camera, surface, caster) for camera in cameras]
    hits = [view.cast_grid(config.neighbor_rays) for view in views]
    seen = [of.point[of.found] for of in hits]
    if not any(len(points) for points in seen):
        raise InputError(UNSEEN)
    n = len(views)
    score = np.zeros((n, n))
    for i, points in enumerate(seen):
        for j in range(n):
            if i != j and len(points):
                score[i, j] = _score(points, views[i], views[j], config)
    pairs = set()
    for i in range(n):
        best = np.argsort(-score[i], kind="stable")[: config.neighbors]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in best if score[i, j] > 0}
    return sorted(pairs)


def _score(points: Array, own: SurfaceView, other: SurfaceView, config: CloudConfig) -> float:
    """How well the other view shows the `points` (n, 3) that this view (`own`) sees, 0..1."""
    pixels = other.camera.project(points + other.surface.origin)
    width, height = other.camera.camera.size
    with np.errstate(invalid="ignore"):
        inside = (pixels > 0).all(1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    if not inside.any():
        return 0.0
    sight = points[inside] - other.center
    hits = other.caster.first_hits(np.broadcast_to(other.center, sight.shape), sight)
    distance = np.linalg.norm(sight, axis=1)
    away = np.linalg.norm(np.nan_to_num(hits.point) - points[inside], axis=1)
    visible = hits.found & (away < config.visible * distance)
    if not visible.any():
        return 0.0
    angle = float(np.median(sight_angles(points[inside][visible], own.center, other.center)))
    return float(visible.sum() / len(points)) * max(0.0, 1 - angle / config.max_neighbor_angle)
