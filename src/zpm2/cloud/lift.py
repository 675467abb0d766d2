"""Polygons lifted onto a surface (paper 3.5.2): diffusion approximation, then edges of projection surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.cloud.diffusion import one_surface
from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.shrink import Shrinker, densified, rings_of
from zpm2.cloud.surface import Surface
from zpm2.cloud.walk import walk
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Polygon, PosedCamera

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PROBES = 200  # samples of a boundary, about, while its scale is looked for
INSIDE = 1e-7  # smallest barycentric weight of an anchor, so that it lies inside its triangle


@dataclass(frozen=True, eq=False)
class Ring:
    """A closed boundary on a surface. Segment k leads from point k to point k + 1 (the last one to the first)."""

    points: Array  # (k, 3) in the surface's coordinates
    faces: Indices  # (k,) the triangle on which each segment lies; -1 where no walk led along the surface


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
        return float(sum(np.linalg.norm(np.roll(r.points, -1, axis=0) - r.points, axis=1).sum() for r in self.rings))


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
    reason = _trial(shapes, view, surface, caster, options)
    bad = [k for k, text in enumerate(reason) if text]
    if options.diffusion == "surface" and bad:
        parts = one_surface([shapes[k] for k in bad], view, surface, caster, options)
        for k, part in zip(bad, parts, strict=True):
            shapes[k] = part
        for k, text in zip(bad, _trial(parts, view, surface, caster, options), strict=True):
            reason[k] = "" if not text else reason[k]
        bad = [k for k in bad if reason[k] and not shapes[k].is_empty]
    shrunk, said = _shrunk([shapes[k] for k in bad], view, surface, caster, options)
    for k, shape, text in zip(bad, shrunk, said, strict=True):
        shapes[k], reason[k] = shape, text
    scale = np.array([(s.area / p.area) ** 0.5 for s, p in zip(shapes, polygons, strict=True)])
    for k in np.flatnonzero(scale < options.min_scale).tolist():
        reason[k] = reason[k] or "too little of it lies on one surface"
    return _on_surface(polygons, shapes, scale, reason, view, surface, caster, options)


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
    hits = _cast(view, surface, caster, np.concatenate([ring for _, ring in rings]))
    mine: dict[int, list[Ring]] = {k: [] for k in good}
    for (k, _), ring in zip(rings, _traced(surface, view, hits, [len(ring) for _, ring in rings]), strict=True):
        mine[k].append(ring)
    for k, boundary in mine.items():
        if all(np.isfinite(ring.points).all() for ring in boundary):
            bridged = sum(int((ring.faces < 0).sum()) for ring in boundary)
            result[k] = Lifted(polygons[k].id, tuple(boundary), shapes[k], float(scale[k]), bridged)
        else:
            result[k] = Failed("the surface has holes under the boundary")
    return result


def outlines(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, step: float
) -> list[Array]:
    """(k, 3) where each boundary, sampled every `step` px, meets the surface; what misses it is left out."""
    rings = [[densified(ring, step) for ring in rings_of(shape)] for shape in shapes]
    counts = [sum(len(ring) for ring in of) for of in rings]
    points = np.concatenate([np.zeros((0, 2)), *(ring for of in rings for ring in of)])
    hits = _cast(view, surface, caster, points)
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
        said = _trial(trial, view, surface, caster, options)
        for k, shape, text in zip(rows, trial, said, strict=True):
            if not text:
                best[k] = shape
        for k, text in zip(rows, said, strict=True):
            reason[k] = text
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


def _trial(
    shapes: Sequence[shapely.Polygon], view: PosedCamera, surface: Surface, caster: RayCaster, options: CloudConfig
) -> list[str]:
    """What is wrong with each boundary on the surface; empty where nothing is."""
    said = [""] * len(shapes)
    rings: list[tuple[int, Array]] = []
    for k, shape in enumerate(shapes):
        parts = rings_of(shape)
        if not parts:
            said[k] = "nothing is left of it"
        for ring in parts:
            length = float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())
            rings.append((k, densified(ring, max(options.step, length / PROBES))))
    if not rings:
        return said
    hits = _cast(view, surface, caster, np.concatenate([ring for _, ring in rings]))
    normals = surface.normals
    depth = (hits.point + surface.origin) @ view.rotation[2] + view.translation[2]
    start = 0
    for k, ring in rings:
        rows = slice(start, start + len(ring))
        start += len(ring)
        said[k] = said[k] or _fault(ring, hits.face[rows], hits.point[rows], depth[rows], normals, view, options)
    return said


def _fault(
    ring: Array, face: Indices, point: Array, depth: Array, normals: Array, view: PosedCamera, options: CloudConfig
) -> str:
    """What is wrong with one ring (k, 2) px, its hits on the surface and their depths; empty where nothing is."""
    if (face < 0).any():
        return "its boundary leaves the surface"
    gap = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    edge = np.linalg.norm(np.roll(point, -1, axis=0) - point, axis=1)
    spread = edge / np.maximum(gap, 1e-9)
    if spread.max() > options.max_edge * np.median(spread):
        return "its boundary jumps between surfaces"
    fold = (normals[face] * normals[np.roll(face, -1)]).sum(1)
    if fold.min() < np.cos(np.radians(options.max_fold)):
        return "the surface is folded under its boundary"
    seen = np.linalg.norm(np.ptp(ring, axis=0)) * np.median(depth) / view.camera.focal
    if np.linalg.norm(np.ptp(point, axis=0)) > options.max_size * seen:
        return "it is far larger than its image allows"
    return ""


def _cast(view: PosedCamera, surface: Surface, caster: RayCaster, points: Array) -> Hits:
    """First hits of the lines of sight through (n, 2) px."""
    origin = np.broadcast_to(view.center - surface.origin, (len(points), 3))
    return caster.first_hits(origin, view.directions(points))


def _traced(surface: Surface, view: PosedCamera, hits: Hits, counts: Sequence[int]) -> list[Ring]:
    """Closed boundaries through the hits of rings of `counts` samples, along the surface."""
    weights = np.clip(hits.weights, INSIDE, None)
    weights /= weights.sum(1, keepdims=True)
    anchors = np.full((len(hits.face), 3), np.nan)
    found = hits.found
    anchors[found] = np.einsum("nk,nki->ni", weights[found], surface.corners[hits.face[found]])
    start = np.cumsum([0, *counts])
    following = np.arange(len(anchors)) + 1
    following[start[1:] - 1] = start[:-1]
    possible = np.flatnonzero(found & found[following])
    targets = following[possible]
    center = np.broadcast_to(view.center - surface.origin, (len(possible), 3))
    walks = walk(surface, (hits.face[possible], anchors[possible]), (hits.face[targets], anchors[targets]), center)
    arrived = np.zeros(len(anchors), bool)
    arrived[possible] = walks.arrived
    crossed = np.zeros(len(anchors), np.int64)
    crossed[possible] = np.diff(walks.start)
    at = np.arange(len(anchors)) + np.cumsum(crossed) - crossed  # each anchor, and after it the crossings of its walk
    is_anchor = np.zeros(len(anchors) + len(walks.points), bool)
    is_anchor[at] = True
    points, faces = np.empty((len(is_anchor), 3)), np.empty(len(is_anchor), np.int64)
    points[is_anchor], points[~is_anchor] = anchors, walks.points
    faces[is_anchor], faces[~is_anchor] = np.where(arrived, hits.face, -1), walks.faces
    first = np.append(at, len(points))[start]
    return [Ring(points[a:b], faces[a:b]) for a, b in pairwise(first)]
