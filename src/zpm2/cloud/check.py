"""Cross-check: both views of a true match lift it to the same place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.cloud.lift import Lifted, outline_in, sampled_boundaries
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Polygon

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Agreement:
    """How well two views agree where a region lies."""

    overlap: float  # 0..1, IoU of a lifted polygon, projected into the other view, with its partner; mean of both ways
    distance: float | None  # units of the mesh, median between the two lifted boundaries; None if one misses the mesh
    size: float  # units of the mesh, sqrt of the area inside the whole boundary, projected onto its plane

    def objection(self, config: CloudConfig) -> str:
        """Why the match is rejected; empty if it is accepted."""
        if self.overlap < config.min_overlap:
            return f"left and right are not the same place: overlap {self.overlap:.2f}"
        if self.distance is not None and self.distance > config.max_distance * self.size:
            return f"left and right lie apart: {self.distance:.3g} at a size of {self.size:.3g}"
        return ""


def cross_check(
    polygons: Sequence[tuple[Polygon, Polygon]],
    lifted: Sequence[tuple[Lifted | Failed, Lifted | Failed]],
    views: tuple[SurfaceView, SurfaceView],
    config: CloudConfig,
) -> list[Agreement | Failed]:
    """The agreement of each matched pair of polygons. If neither polygon was lifted, the failure of the left one.

    If only part of a polygon was lifted, it is compared with the same share of its partner's area. Distances are
    measured between the whole boundaries, where their rays meet the surface. They are medians, so that parts that hang
    over an edge do not count.
    """
    known = [k for k, pair in enumerate(lifted) if any(pair)]
    boundaries = [
        sampled_boundaries([polygons[k][side].shape for k in known], views[side], config.step) for side in (0, 1)
    ]
    distances = {k: _distance(a, b) for k, a, b in zip(known, *boundaries, strict=True)}
    result: list[Agreement | Failed] = []
    for k, pair in enumerate(lifted):
        overlaps, sizes = [], []
        for side, own in enumerate(pair):
            if isinstance(own, Lifted):
                other = views[1 - side]
                there = outline_in(own.rings, other.camera, other.surface)
                overlaps.append(_overlap(there, polygons[k][1 - side].shape, own.scale**2))
                sizes.append(_size(own) / own.scale)
        if overlaps:
            result.append(Agreement(float(np.mean(overlaps)), distances.get(k), float(np.mean(sizes))))
        else:
            result.append(next(side for side in pair if isinstance(side, Failed)))
    return result


def _distance(a: Array, b: Array) -> float | None:
    """Symmetric median distance of two dense boundaries (n, 3), (m, 3)."""
    if len(a) == 0 or len(b) == 0:
        return None
    return float((np.median(cKDTree(a).query(b)[0]) + np.median(cKDTree(b).query(a)[0])) / 2)


def _overlap(part: shapely.Geometry, whole: shapely.Geometry, share: float) -> float:
    """IoU of a lifted part with the whole partner, whose area counts only by the `share` of it that was lifted."""
    both = part.intersection(whole).area
    expected = max(share * whole.area, both)
    return float(both / max(part.area + expected - both, 1e-300))


def _size(lifted: Lifted) -> float:
    """Square root of the area that the exterior encloses on its plane (Newell's method)."""
    ring = lifted.rings[0].points
    ring = ring - ring.mean(0)
    return float(np.sqrt(np.linalg.norm(np.cross(ring, np.roll(ring, -1, axis=0)).sum(0)) / 2))
