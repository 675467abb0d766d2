"""Which views are worth matching with each other."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.rays import RayCaster
from zpm2.cloud.seen import UNSEEN, probe
from zpm2.cloud.surface import Surface
from zpm2.errors import InputError
from zpm2.geometry import sight_angles
from zpm2.model import PosedCamera

Array = NDArray[np.float64]
PROBES = 1500  # rays of each view
WIDEST = 60.0  # degrees between lines of sight, from which on regions do not look alike
SAME = 1e-3  # of the distance: a point that a ray meets this near is seen


def neighbor_pairs(
    cameras: Sequence[PosedCamera], surface: Surface, caster: RayCaster, count: int
) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of each view with the `count` others that see most of what it sees, from directions that do
    not differ much: share of its surface points that the other one sees, times 1 - angle / 60 degrees.

    `InputError` where no view sees the surface.
    """
    hits = [probe(camera, surface, caster, PROBES) for camera in cameras]
    probes = [of.point[of.found] for of in hits]
    if not any(len(points) for points in probes):
        raise InputError(UNSEEN)
    n = len(cameras)
    score = np.zeros((n, n))
    for i, points in enumerate(probes):
        for j in range(n):
            if i != j and len(points):
                score[i, j] = _worth(points, cameras[i], cameras[j], surface, caster)
    pairs = set()
    for i in range(n):
        best = np.argsort(-score[i], kind="stable")[:count]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in best if score[i, j] > 0}
    return sorted(pairs)


def _worth(points: Array, own: PosedCamera, other: PosedCamera, surface: Surface, caster: RayCaster) -> float:
    pixels = other.project(points + surface.origin)
    width, height = other.camera.size
    with np.errstate(invalid="ignore"):
        inside = (pixels > 0).all(1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    if not inside.any():
        return 0.0
    there = other.center - surface.origin
    sight = points[inside] - there
    hits = caster.first_hits(np.broadcast_to(there, sight.shape), sight)
    distance = np.linalg.norm(sight, axis=1)
    seen = hits.found & (np.linalg.norm(np.nan_to_num(hits.point) - points[inside], axis=1) < SAME * distance)
    if not seen.any():
        return 0.0
    angle = float(np.median(sight_angles(points[inside][seen], own.center - surface.origin, there)))
    return float(seen.sum() / len(points)) * max(0.0, 1 - angle / WIDEST)
