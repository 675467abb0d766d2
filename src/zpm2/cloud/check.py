"""Left against right: a true match is lifted to one place by both of its views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.cloud.lift import Lifted, outline_in, outlines
from zpm2.cloud.rays import RayCaster
from zpm2.cloud.surface import Surface
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Polygon, PosedCamera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Agreement:
    """How well two views agree on the place of a region."""

    overlap: float  # 0..1, IoU of the lifted polygon, seen from the other view, with its partner; mean of both ways
    distance: float | None  # units of the mesh, between the boundaries that each view lifts, median; None: one misses
    size: float  # units of the mesh, sqrt of the area that the whole boundary has on its plane

    def fault(self, options: CloudConfig) -> str:
        """What speaks against the match; empty where nothing does."""
        if self.overlap < options.min_overlap:
            return f"left and right are not the same place: overlap {self.overlap:.2f}"
        if self.distance is not None and self.distance > options.max_distance * self.size:
            return f"left and right lie apart: {self.distance:.3g} at a size of {self.size:.3g}"
        return ""


def cross_check(
    polygons: Sequence[tuple[Polygon, Polygon]],
    lifted: Sequence[tuple[Lifted | Failed, Lifted | Failed]],
    views: tuple[PosedCamera, PosedCamera],
    surface: Surface,
    caster: RayCaster,
    options: CloudConfig,
) -> list[Agreement | Failed]:
    """The agreement of each matched pair of polygons of which at least one was lifted; else the left one's failure.

    Of a polygon that was lifted in part only, the same share is expected of its partner. Distances are between the
    whole boundaries, as rays meet the surface, and medians, so that parts which hang over an edge do not count.
    """
    known = [k for k, pair in enumerate(lifted) if any(pair)]
    outline = [
        outlines([polygons[k][side].shape for k in known], views[side], surface, caster, options.step)
        for side in (0, 1)
    ]
    distances = {k: _distance(a, b) for k, a, b in zip(known, *outline, strict=True)}
    result: list[Agreement | Failed] = []
    for k, pair in enumerate(lifted):
        overlaps, sizes = [], []
        for side, own in enumerate(pair):
            if isinstance(own, Lifted):
                there = outline_in(own.rings, views[1 - side], surface)
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
    """IoU of a part with the share of the whole that it should be."""
    both = part.intersection(whole).area
    expected = max(share * whole.area, both)
    return float(both / max(part.area + expected - both, 1e-300))


def _size(lifted: Lifted) -> float:
    """sqrt of the area of the exterior on its plane (Newell)."""
    ring = lifted.rings[0].points
    ring = ring - ring.mean(0)
    return float(np.sqrt(np.linalg.norm(np.cross(ring, np.roll(ring, -1, axis=0)).sum(0)) / 2))
