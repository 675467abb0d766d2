"""Whether the boundary of a polygon lies on one surface: the three constraints of polygon diffusion (paper 3.5.2, (1)),
which are also the checks of outlier rejection (4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.shrink import densified, rings_of, spacing
from zpm2.cloud.surface import Surface
from zpm2.config import CloudConfig
from zpm2.model import PosedCamera

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong with a boundary."""

    reason: str
    at: Array  # (k, 2) samples where it is, image px: those that miss, or lie on the surface behind


def cast(view: PosedCamera, surface: Surface, caster: RayCaster, points: Array) -> Hits:
    """First hits of the lines of sight through (n, 2) px (paper, Eq. raydir)."""
    origin = np.broadcast_to(view.center - surface.origin, (len(points), 3))
    return caster.first_hits(origin, view.directions(points))


def faults(
    shapes: Sequence[shapely.Polygon],
    view: PosedCamera,
    surface: Surface,
    caster: RayCaster,
    options: CloudConfig,
    usual: Array | None = None,
) -> list[Fault | None]:
    """What is wrong with each of n boundaries on the surface; None where nothing is. All of them in one cast of rays.

    usual: (n,) distances on the surface for each px that are usual inside of each, if they are known.
    """
    nowhere = np.zeros((0, 2))
    said: list[Fault | None] = [Fault("nothing is left of it", nowhere) if shape.is_empty else None for shape in shapes]
    rings = [
        (k, densified(ring, spacing(shape, options.step))) for k, shape in enumerate(shapes) for ring in rings_of(shape)
    ]
    if not rings:
        return said
    hits = cast(view, surface, caster, np.concatenate([ring for _, ring in rings]))
    depth = (hits.point + surface.origin) @ view.rotation[2] + view.translation[2]
    start = 0
    for k, ring in rings:
        rows = slice(start, start + len(ring))
        start += len(ring)
        if said[k] is None:
            normals = surface.normals[hits.face[rows]]
            least = 0.0 if usual is None else float(usual[k])
            said[k] = _fault(ring, hits.found[rows], hits.point[rows], depth[rows], normals, view, options, least)
    return said


def _fault(
    ring: Array,
    found: Flags,
    point: Array,
    depth: Array,
    normals: Array,
    view: PosedCamera,
    options: CloudConfig,
    usual: float,
) -> Fault | None:
    """What is wrong with one ring (k, 2) px, its hits (k, 3), their depths (k,) and normals (k, 3)."""
    if not found.all():
        return Fault("its boundary leaves the surface", ring[~found])
    gap = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    edge = np.linalg.norm(np.roll(point, -1, axis=0) - point, axis=1)
    spread = edge / np.maximum(gap, 1e-9)
    jumps = spread > options.max_edge * max(float(np.median(spread)), usual)
    if jumps.any():
        return Fault("its boundary jumps between surfaces", _behind(ring, depth, jumps))
    folds = (normals * np.roll(normals, -1, axis=0)).sum(1) < np.cos(np.radians(options.max_fold))
    if folds.any():
        return Fault("the surface is folded under its boundary", _behind(ring, depth, folds))
    seen = np.linalg.norm(np.ptp(ring, axis=0)) * np.median(depth) / view.camera.focal
    if np.linalg.norm(np.ptp(point, axis=0)) > options.max_size * seen:
        return Fault("it is far larger than its image allows", np.zeros((0, 2)))
    return None


def _behind(ring: Array, depth: Array, edges: Flags) -> Array:
    """The farther end of each of the edges (k,) of a ring."""
    first = np.flatnonzero(edges)
    second = (first + 1) % len(ring)
    return ring[np.where(depth[first] > depth[second], first, second)]
