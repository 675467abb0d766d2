"""Polygons lifted onto a surface (paper 3.5.2): diffusion approximation, then edges of projection surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cloud.diffusion import one_surface, without_places
from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.shrink import Shrinker, densified, rings_of, spacing
from zpm2.cloud.surface import Surface
from zpm2.cloud.trial import Fault, cast, faults
from zpm2.cloud.walk import walk
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Polygon, PosedCamera
from zpm2.polygons.repair import repaired

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
ROUNDS = 4  # of taking away where an outline runs across an edge
MISSED = 0.05  # of the samples of a boundary may fall through the surface; the rest is joined
INSIDE = 1e-7  # smallest barycentric weight of an anchor, so that it lies inside its triangle


@dataclass(frozen=True, eq=False)
class Ring:
    """A closed boundary on a surface. Segment k leads from point k to point k + 1 (the last one to the first)."""

    points: Array  # (k, 3) in the surface's coordinates
    faces: Indices  # (k,) the triangle on which each segment lies; -1 where no walk led along the surface

    @property
    def length(self) -> float:
        """In units of the mesh."""
        return float(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1).sum())


@dataclass(frozen=True, eq=False)
class Lifted:
    """A polygon on the surface."""

    id: int
    rings: tuple[Ring, ...]  # exterior first
    shape: shapely.Polygon  # the part of the polygon that was lifted, image px
    scale: float  # sqrt of the share of its area, s of the diffusion; 1: the whole polygon
    bridged: int  # segments that are straight, as no walk led along the surface

    @property
    def length(self) -> float:
        """Of all boundaries, in units of the mesh."""
        return sum(ring.length for ring in self.rings)


def lift(
    polygons: Sequence[Polygon],
    view: PosedCamera,
    surface: Surface,
    caster: RayCaster,
    options: CloudConfig | None = None,
) -> list[Lifted | Failed]:
    """Each polygon of a view on the surface, or why it cannot be there.

    A polygon can be lifted if its boundary lies on one surface: all samples meet it, no edge between neighbours is much
    longer than the others for its px, the normals of neighbours do not fold, and the whole is no larger than its image
    allows. Of one that cannot, the part on one surface is tried (`diffusion.one_surface`, unless the configuration says
    "scale"), and then the largest scale is looked for by bisection (`Shrinker`). All polygons take their trials
    together, in one cast of rays.
    """
    options = options or CloudConfig()
    shapes = [polygon.shape for polygon in polygons]
    reason = [_text(fault) for fault in faults(shapes, view, surface, caster, options)]
    bad = [k for k, text in enumerate(reason) if text]
    if options.diffusion == "surface" and bad:
        parts, said = _parts([shapes[k] for k in bad], view, surface, caster, options)
        for k, part, text in zip(bad, parts, said, strict=True):
            shapes[k], reason[k] = part, text and reason[k]
        bad = [k for k in bad if reason[k] and not shapes[k].is_empty]
    shrunk, said = _shrunk([shapes[k] for k in bad], view, surface, caster, options)
    for k, shape, text in zip(bad, shrunk, said, strict=True):
        shapes[k], reason[k] = shape, text
    scale = np.array([(s.area / p.area) ** 0.5 for s, p in zip(shapes, polygons, strict=True)])
    for k in np.flatnonzero(scale < options.min_scale).tolist():
        reason[k] = reason[k] or "too little of it lies on one surface"
    return _on_surface(polygons, shapes, scale, reason, view, surface, caster, options)


def _parts(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, options: CloudConfig
) -> tuple[list[shapely.Polygon], list[str]]:
    """The part of each shape on one surface, and what is wrong with its boundary still; empty where nothing is.

    The inside hangs together, but its outline may run across an edge between samples of the inside: those places are
    taken away, a few times.
    """
    parts, usual = one_surface(shapes, view, surface, caster, options)
    said = faults(parts, view, surface, caster, options, usual)
    for _ in range(ROUNDS):
        again = [k for k, fault in enumerate(said) if fault is not None and len(fault.at)]
        if not again:
            break
        for k in again:
            fault = said[k]
            assert fault is not None
            parts[k] = without_places(parts[k], fault.at, 1.5 * spacing(shapes[k], options.step))
        mended = faults([parts[k] for k in again], view, surface, caster, options, usual[again])
        for k, fault in zip(again, mended, strict=True):
            said[k] = fault
    return parts, [_text(fault) for fault in said]


def _text(fault: Fault | None) -> str:
    return "" if fault is None else fault.reason


def _on_surface(
    polygons: Sequence[Polygon],
    shapes: Sequence[shapely.Polygon],
    scale: Array,
    reason: Sequence[str],
    view: PosedCamera,
    surface: Surface,
    caster: RayCaster,
    options: CloudConfig,
) -> list[Lifted | Failed]:
    """The boundaries of those shapes that have no reason not to, traced along the surface."""
    result: list[Lifted | Failed] = [Failed(text) for text in reason]
    good = [k for k, text in enumerate(reason) if not text]
    rings = [(k, densified(ring, options.step)) for k in good for ring in rings_of(shapes[k])]
    if not rings:
        return result
    hits = cast(view, surface, caster, np.concatenate([ring for _, ring in rings]))
    bounds = np.cumsum([0, *(len(ring) for _, ring in rings)])
    met = [int(hits.found[a:b].sum()) for a, b in pairwise(bounds)]
    mine: dict[int, list[Ring]] = {k: [] for k in good}
    kept = Hits(hits.face[hits.found], hits.point[hits.found], hits.weights[hits.found])
    for (k, ring), traced, count in zip(rings, _traced(surface, view, kept, met), met, strict=True):
        if count < max(3, (1 - MISSED) * len(ring)):
            result[k] = Failed("the surface has holes under its boundary")
        mine[k].append(traced)
    for k, boundary in mine.items():
        if result[k] == Failed(""):
            bridged = sum(int((ring.faces < 0).sum()) for ring in boundary)
            result[k] = Lifted(polygons[k].id, tuple(boundary), shapes[k], float(scale[k]), bridged)
    return result


def outline_in(rings: Sequence[Ring], view: PosedCamera, surface: Surface) -> shapely.Geometry:
    """A boundary on a surface as a view sees it, px, whatever hides it; empty where a part is behind the view."""
    seen = [view.project(ring.points + surface.origin) for ring in rings]
    if not all(np.isfinite(ring).all() for ring in seen):
        return shapely.Polygon()
    return repaired(shapely.Polygon(seen[0], seen[1:]))


def outlines(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, step: float
) -> list[Array]:
    """(k, 3) where each boundary, sampled every `step` px, meets the surface; what misses it is left out."""
    rings = [[densified(ring, step) for ring in rings_of(shape)] for shape in shapes]
    counts = [sum(len(ring) for ring in of) for of in rings]
    points = np.concatenate([np.zeros((0, 2)), *(ring for of in rings for ring in of)])
    hits = cast(view, surface, caster, points)
    bounds = np.cumsum([0, *counts])
    return [hits.point[a:b][hits.found[a:b]] for a, b in pairwise(bounds)]


def _shrunk(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, options: CloudConfig
) -> tuple[list[shapely.Polygon], list[str]]:
    """Each shape at the largest scale below 1 that passes, and why the least one did not where none does."""
    shrinkers = [Shrinker(shape) for shape in shapes]
    n = len(shapes)
    best, reason = list(shapes), [""] * n
    low, high = np.full(n, options.min_scale), np.ones(n)

    def test(rows: Indices, scales: Array) -> NDArray[np.bool_]:
        trial = [shrinkers[k].at(float(scale)) for k, scale in zip(rows, scales, strict=True)]
        said = [_text(fault) for fault in faults(trial, view, surface, caster, options)]
        for k, shape, text in zip(rows, trial, said, strict=True):
            reason[k] = text
            if not text:
                best[k] = shape
        return np.array([not text for text in said], bool)

    everyone = np.arange(n)
    open_ = everyone[test(everyone, low)]
    for _ in range(options.halvings):
        middle = (low[open_] + high[open_]) / 2
        passed = test(open_, middle)
        low[open_[passed]], high[open_[~passed]] = middle[passed], middle[~passed]
    for k in open_:
        reason[k] = ""
    return best, reason


def _traced(surface: Surface, view: PosedCamera, hits: Hits, counts: Sequence[int]) -> list[Ring]:
    """Closed boundaries through the hits of rings of `counts` samples, along the surface."""
    weights = np.clip(hits.weights, INSIDE, None)
    weights /= weights.sum(1, keepdims=True)
    anchors = np.einsum("nk,nki->ni", weights, surface.corners[hits.face])
    start = np.cumsum([0, *counts])
    following = np.arange(len(anchors)) + 1
    last = start[1:] - 1
    following[last[last >= start[:-1]]] = start[:-1][last >= start[:-1]]
    center = np.broadcast_to(view.center - surface.origin, anchors.shape)
    walks = walk(surface, (hits.face, anchors), (hits.face[following], anchors[following]), center)
    crossed = np.diff(walks.start)
    at = np.arange(len(anchors)) + np.cumsum(crossed) - crossed  # each anchor, and after it the crossings of its walk
    is_anchor = np.zeros(len(anchors) + len(walks.points), bool)
    is_anchor[at] = True
    points, faces = np.empty((len(is_anchor), 3)), np.empty(len(is_anchor), np.int64)
    points[is_anchor], points[~is_anchor] = anchors, walks.points
    faces[is_anchor], faces[~is_anchor] = np.where(walks.arrived, hits.face, -1), walks.faces
    first = np.append(at, len(points))[start]
    return [Ring(points[a:b], faces[a:b]) for a, b in pairwise(first)]
