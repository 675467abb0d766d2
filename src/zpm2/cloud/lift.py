"""Lifts polygons onto a surface (paper 3.5.2): diffusion approximation, then edges of projection surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cloud.constraints import Violation, violations
from zpm2.cloud.diffusion import one_surface, without_discs
from zpm2.cloud.rays import Hits
from zpm2.cloud.scaling import PolygonScaler, densified, rings_of, sample_spacing
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.surface_path import trace_paths
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Polygon, PosedCamera
from zpm2.polygons.repair import repaired

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MIN_WEIGHT = 1e-7  # smallest barycentric weight of an anchor, which keeps it inside its triangle


@dataclass(frozen=True, eq=False)
class SurfaceRing:
    """A closed boundary on a surface. Segment k leads from point k to point k + 1 (the last one to the first)."""

    points: Array  # (k, 3) in the surface's coordinates
    faces: Indices  # (k,) triangle on which each segment lies; -1: straight, as no path along the surface exists

    @property
    def length(self) -> float:
        """Length, in units of the mesh."""
        return float(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1).sum())


@dataclass(frozen=True, eq=False)
class Lifted:
    """A polygon lifted onto the surface."""

    id: int
    rings: tuple[SurfaceRing, ...]  # exterior first
    shape: shapely.Polygon  # the part of the polygon that was lifted, image px
    scale: float  # sqrt of that part's share of the area: s of the diffusion; 1 for the whole polygon
    bridged: int  # number of straight segments, where no path along the surface exists

    @property
    def length(self) -> float:
        """Total length of the boundaries, in units of the mesh."""
        return sum(ring.length for ring in self.rings)


def lift(polygons: Sequence[Polygon], view: SurfaceView, config: CloudConfig) -> list[Lifted | Failed]:
    """Each polygon of a view lifted onto the surface, or why it cannot be lifted.

    A polygon can be lifted if its boundary lies on one surface. This means: all samples of the boundary meet the
    surface; no edge between neighbouring samples is much longer than the others, per px; the surface is not folded
    between neighbours; and the whole is no larger than its image allows. For any other polygon, the part on one surface
    is tried first (`diffusion.one_surface`, unless the configuration says "scale"). If that fails, the largest scale
    that passes is found by bisection (`PolygonScaler`). Each trial casts the rays of all polygons at once.
    """
    shapes = [polygon.shape for polygon in polygons]
    reasons = _reasons(violations(shapes, view, config))
    bad = [k for k, text in enumerate(reasons) if text]
    if config.diffusion == "surface" and bad:
        parts, left = _parts([shapes[k] for k in bad], view, config)
        for k, part, text in zip(bad, parts, left, strict=True):
            shapes[k], reasons[k] = part, text and reasons[k]
        bad = [k for k in bad if reasons[k] and not shapes[k].is_empty]
    scaled, left = _scaled([shapes[k] for k in bad], view, config)
    for k, shape, text in zip(bad, scaled, left, strict=True):
        shapes[k], reasons[k] = shape, text
    scales = np.array([(s.area / p.area) ** 0.5 for s, p in zip(shapes, polygons, strict=True)])
    for k in np.flatnonzero(scales < config.min_scale).tolist():
        reasons[k] = reasons[k] or "too little of it lies on one surface"
    result: list[Lifted | Failed] = [Failed(text) for text in reasons]
    good = [k for k, text in enumerate(reasons) if not text]
    for k, rings in zip(good, _boundaries([shapes[k] for k in good], view, config), strict=True):
        if isinstance(rings, Failed):
            result[k] = rings
        else:
            bridged = sum(int((ring.faces < 0).sum()) for ring in rings)
            result[k] = Lifted(polygons[k].id, rings, shapes[k], float(scales[k]), bridged)
    return result


def outline_in(rings: Sequence[SurfaceRing], camera: PosedCamera, surface: SurfaceMesh) -> shapely.Geometry:
    """A boundary on a surface projected into a camera, px, with its hidden parts; empty if `PosedCamera.project` cannot
    project all of it."""
    seen = [camera.project(ring.points + surface.origin) for ring in rings]
    if not all(np.isfinite(ring).all() for ring in seen):
        return shapely.Polygon()
    return repaired(shapely.Polygon(seen[0], seen[1:]))


def sampled_boundaries(shapes: Sequence[shapely.Polygon], view: SurfaceView, step: float) -> list[Array]:
    """(k, 3) points where each boundary, sampled every `step` px, meets the surface; without samples that miss it."""
    rings = [[densified(ring, step) for ring in rings_of(shape)] for shape in shapes]
    counts = [sum(len(ring) for ring in of) for of in rings]
    hits = view.cast(np.concatenate([np.zeros((0, 2)), *(ring for of in rings for ring in of)]))
    bounds = np.cumsum([0, *counts])
    return [hits.point[a:b][hits.found[a:b]] for a, b in pairwise(bounds)]


def _reasons(found: Sequence[Violation | None]) -> list[str]:
    return ["" if violation is None else violation.reason for violation in found]


def _parts(
    shapes: Sequence[shapely.Polygon], view: SurfaceView, config: CloudConfig
) -> tuple[list[shapely.Polygon], list[str]]:
    """The part of each shape on one surface, and the constraint that its boundary still violates (empty for none).

    The samples inside are connected, but the outline may still cross an edge between them. Such places are cut away,
    in a few rounds.
    """
    parts, spacings = one_surface(shapes, view, config)
    found = violations(parts, view, config, spacings)
    for _ in range(config.cut_rounds):
        again = [k for k, violation in enumerate(found) if violation is not None and len(violation.at)]
        if not again:
            break
        for k in again:
            violation = found[k]
            assert violation is not None
            radius = config.cut_radius * sample_spacing(shapes[k], config)
            parts[k] = without_discs(parts[k], violation.at, radius, config)
        for k, violation in zip(
            again, violations([parts[k] for k in again], view, config, spacings[again]), strict=True
        ):
            found[k] = violation
    return parts, _reasons(found)


def _scaled(
    shapes: Sequence[shapely.Polygon], view: SurfaceView, config: CloudConfig
) -> tuple[list[shapely.Polygon], list[str]]:
    """Each shape at the largest scale below 1 that passes. If none does, the reason why the smallest did not."""
    scalers = [PolygonScaler(shape) for shape in shapes]
    n = len(shapes)
    best, reasons = list(shapes), [""] * n
    low, high = np.full(n, config.min_scale), np.ones(n)

    def test(rows: Indices, scales: Array) -> NDArray[np.bool_]:
        tried = [scalers[k].at(float(scale)) for k, scale in zip(rows, scales, strict=True)]
        found = _reasons(violations(tried, view, config))
        for k, shape, text in zip(rows, tried, found, strict=True):
            reasons[k] = text
            if not text:
                best[k] = shape
        return np.array([not text for text in found], bool)

    every = np.arange(n)
    open_ = every[test(every, low)]
    for _ in range(config.halvings):
        middle = (low[open_] + high[open_]) / 2
        passed = test(open_, middle)
        low[open_[passed]], high[open_[~passed]] = middle[passed], middle[~passed]
    for k in open_:
        reasons[k] = ""
    return best, reasons


def _boundaries(
    shapes: Sequence[shapely.Polygon], view: SurfaceView, config: CloudConfig
) -> list[tuple[SurfaceRing, ...] | Failed]:
    """The boundary of each shape, traced along the surface."""
    rings = [(k, densified(ring, config.step)) for k, shape in enumerate(shapes) for ring in rings_of(shape)]
    if not rings:
        return []
    hits = view.cast(np.concatenate([ring for _, ring in rings]))
    bounds = np.cumsum([0, *(len(ring) for _, ring in rings)])
    met = [int(hits.found[a:b].sum()) for a, b in pairwise(bounds)]
    kept = Hits(hits.face[hits.found], hits.point[hits.found], hits.weights[hits.found])
    traced: list[list[SurfaceRing]] = [[] for _ in shapes]
    torn = set()
    for (k, samples), ring, count in zip(rings, _traced(view, kept, met, config), met, strict=True):
        traced[k].append(ring)
        if count < max(3, (1 - config.max_missed) * len(samples)):
            torn.add(k)
    return [
        Failed("the surface has holes under its boundary") if k in torn else tuple(found)
        for k, found in enumerate(traced)
    ]


def _traced(view: SurfaceView, hits: Hits, counts: Sequence[int], config: CloudConfig) -> list[SurfaceRing]:
    """Closed boundaries along the surface, through the hits. counts: the number of hits of each ring, in order."""
    surface = view.surface
    weights = np.clip(hits.weights, MIN_WEIGHT, None)
    weights /= weights.sum(1, keepdims=True)
    anchors = np.einsum("nk,nki->ni", weights, surface.corners[hits.face])
    start = np.cumsum([0, *counts])
    following = np.arange(len(anchors)) + 1
    last = start[1:] - 1
    following[last[last >= start[:-1]]] = start[:-1][last >= start[:-1]]
    centers = np.broadcast_to(view.center, anchors.shape)
    target = hits.face[following], anchors[following]
    paths = trace_paths(surface, (hits.face, anchors), target, centers, config)
    crossed = np.diff(paths.start)
    at = np.arange(len(anchors)) + np.cumsum(crossed) - crossed  # each anchor is followed by the crossings of its path
    is_anchor = np.zeros(len(anchors) + len(paths.points), bool)
    is_anchor[at] = True
    points, faces = np.empty((len(is_anchor), 3)), np.empty(len(is_anchor), np.int64)
    points[is_anchor], points[~is_anchor] = anchors, paths.points
    faces[is_anchor], faces[~is_anchor] = np.where(paths.arrived, hits.face, -1), paths.faces
    first = np.append(at, len(points))[start]
    return [SurfaceRing(points[a:b], faces[a:b]) for a, b in pairwise(first)]
