"""Does the boundary of a polygon lie on one surface? The three constraints of polygon diffusion (paper 3.5.2, (1)).

They are also the checks of outlier rejection (4).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cloud.scaling import densified, rings_of, sample_spacing
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import CloudConfig

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
NOWHERE = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Violation:
    """A constraint that a boundary violates."""

    reason: str
    at: Array  # (k, 2) image px of the samples at fault: they miss the surface, or lie on the one behind


@dataclass(frozen=True, eq=False)
class SampledRing:
    """The k samples of a ring, and where they meet the surface."""

    pixels: Array  # (k, 2)
    found: Flags  # (k,)
    points: Array  # (k, 3) NaN where not found
    depths: Array  # (k,)
    normals: Array  # (k, 3) of the surface there


def violations(
    shapes: Sequence[shapely.Polygon], view: SurfaceView, config: CloudConfig, spacings: Array | None = None
) -> list[Violation | None]:
    """The first constraint that each of n boundaries violates; None if it violates none. Casts all rays at once.

    spacings: (n,) usual distance on the surface per px inside each polygon, if known.
    """
    result = [Violation("nothing is left of it", NOWHERE) if shape.is_empty else None for shape in shapes]
    rings = [
        (k, densified(ring, sample_spacing(shape, config)))
        for k, shape in enumerate(shapes)
        for ring in rings_of(shape)
    ]
    if not rings:
        return result
    hits = view.cast(np.concatenate([ring for _, ring in rings]))
    depths = view.depths(hits.point)
    start = 0
    for k, ring in rings:
        rows = slice(start, start + len(ring))
        start += len(ring)
        if result[k] is None:
            normals = view.surface.normals[hits.face[rows]]
            sampled = SampledRing(ring, hits.found[rows], hits.point[rows], depths[rows], normals)
            result[k] = _violation(sampled, view, config, 0.0 if spacings is None else float(spacings[k]))
    return result


def _violation(ring: SampledRing, view: SurfaceView, config: CloudConfig, spacing: float) -> Violation | None:
    """The constraint that one ring violates. spacing: the usual distance on the surface per px inside; 0 if unknown."""
    if not ring.found.all():
        return Violation("its boundary leaves the surface", ring.pixels[~ring.found])
    gap = np.linalg.norm(np.roll(ring.pixels, -1, axis=0) - ring.pixels, axis=1)
    edge = np.linalg.norm(np.roll(ring.points, -1, axis=0) - ring.points, axis=1)
    per_pixel = edge / np.maximum(gap, 1e-9)
    jumps = per_pixel > config.max_edge * max(float(np.median(per_pixel)), spacing)
    if jumps.any():
        return Violation("its boundary jumps between surfaces", _behind(ring, jumps))
    bend = (ring.normals * np.roll(ring.normals, -1, axis=0)).sum(1)
    folds = bend < np.cos(np.radians(config.max_fold))
    if folds.any():
        return Violation("the surface is folded under its boundary", _behind(ring, folds))
    facing = np.linalg.norm(np.ptp(ring.pixels, axis=0)) * np.median(ring.depths) / view.camera.camera.focal
    if np.linalg.norm(np.ptp(ring.points, axis=0)) > config.max_size * facing:
        return Violation("it is far larger than its image allows", NOWHERE)
    return None


def _behind(ring: SampledRing, edges: Flags) -> Array:
    """Pixel of the end farther from the camera, for each of the marked edges (k,) of a ring."""
    first = np.flatnonzero(edges)
    second = (first + 1) % len(ring.pixels)
    return ring.pixels[np.where(ring.depths[first] > ring.depths[second], first, second)]
