"""Where rays first meet a surface (paper 3.5.2, Eq. raydir): with Embree, or else by testing every triangle."""

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.surface import SurfaceMesh

Array = NDArray[np.float64]
PAIRS_AT_ONCE = 2_000_000  # pairs of a ray and a triangle tested in one step; bounds the memory


@dataclass(frozen=True, eq=False)
class Hits:
    """The first hit of each of n rays."""

    face: NDArray[np.int64]  # (n,) the triangle; -1 if a ray meets nothing
    point: Array  # (n, 3) point on that triangle, in the surface's coordinates; NaN without a hit
    weights: Array  # (n, 3) its barycentric weights, >= 0, sum 1; NaN without a hit

    @property
    def found(self) -> NDArray[np.bool_]:
        """(n,) whether each ray meets the surface."""
        return np.asarray(self.face >= 0)

    def __getitem__(self, rows: slice) -> "Hits":
        return Hits(self.face[rows], self.point[rows], self.weights[rows])


class RayCaster(Protocol):
    """Casts rays onto one surface."""

    note: str | None  # what the user should know about this caster

    def first_hits(self, origins: Array, directions: Array) -> Hits:
        """The hits of n rays: origins (n, 3) in the surface's coordinates, directions (n, 3) of any length."""
        ...


class Embree:
    """Intel's ray tracing kernels in single precision, through trimesh. Hits are then computed in double precision."""

    note: str | None = None

    def __init__(self, surface: SurfaceMesh) -> None:
        import trimesh
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        self.corners = surface.corners
        mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
        self.tree = RayMeshIntersector(mesh)

    def first_hits(self, origins: Array, directions: Array) -> Hits:
        if len(origins) == 0:
            return _hits(self.corners, np.zeros(0, np.int64), origins, directions)
        length = np.linalg.norm(directions, axis=1, keepdims=True)
        face = self.tree.intersects_first(origins, directions / np.maximum(length, 1e-300))
        return _hits(self.corners, np.asarray(face, np.int64), origins, directions)


class EveryTriangle:
    """Tests every ray against every triangle in double precision (Moeller and Trumbore, 1997).

    It is the reference for tests, and the fallback.
    """

    note: str | None = 'embreex is not installed, so casting rays is slow: pip install "zpm2[cloud]"'

    def __init__(self, surface: SurfaceMesh) -> None:
        self.corners = surface.corners

    def first_hits(self, origins: Array, directions: Array) -> Hits:
        face = np.full(len(origins), -1, np.int64)
        step = max(1, PAIRS_AT_ONCE // max(len(self.corners), 1))
        for start in range(0, len(origins), step):
            rows = slice(start, start + step)
            face[rows] = self._nearest(origins[rows], directions[rows])
        return _hits(self.corners, face, origins, directions)

    def _nearest(self, origins: Array, directions: Array) -> NDArray[np.int64]:
        a = self.corners[:, 0]
        u, v = self.corners[:, 1] - a, self.corners[:, 2] - a
        p = np.cross(directions[:, None], v[None])  # (rays, triangles, 3)
        scale = (p * u).sum(2)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origins[:, None] - a
            first = (s * p).sum(2) / scale
            q = np.cross(s, u[None])
            second = (directions[:, None] * q).sum(2) / scale
            distance = (q * v).sum(2) / scale
            inside = (first >= 0) & (second >= 0) & (first + second <= 1) & (distance > 0) & (scale != 0)
        distance = np.where(inside, distance, np.inf)
        nearest = distance.argmin(1)
        return np.where(np.isfinite(distance[np.arange(len(nearest)), nearest]), nearest, -1)


def open_caster(surface: SurfaceMesh) -> RayCaster:
    """Embree, or the slow fallback, whose `note` says so."""
    if find_spec("embreex") and find_spec("trimesh"):
        return Embree(surface)
    return EveryTriangle(surface)


def _hits(corners: Array, face: NDArray[np.int64], origins: Array, directions: Array) -> Hits:
    """The hits on known faces, in double precision.

    A hit that rounding moves off its face is clipped to the face's edge, so that every point lies on the surface.
    """
    n = len(face)
    weights, found = np.full((n, 3), np.nan), face >= 0
    a, b, c = np.moveaxis(corners[face[found]], 1, 0)
    o, d = origins[found], directions[found]
    # the volumes that the ray spans with each edge (Pluecker) are the barycentric weights, up to a common factor
    volumes = np.stack([np.einsum("ni,ni->n", d, np.cross(p - o, q - o)) for p, q in ((b, c), (c, a), (a, b))], axis=1)
    total = volumes.sum(1, keepdims=True)
    share = np.clip(volumes / np.where(total == 0, 1.0, total), 0.0, None)
    sums = share.sum(1, keepdims=True)
    weights[found] = np.where(sums > 0, share / np.where(sums > 0, sums, 1.0), 1 / 3)
    point = np.full((n, 3), np.nan)
    point[found] = np.einsum("nk,nki->ni", weights[found], corners[face[found]])
    return Hits(face, point, weights)
