"""Meshes of surfaces that are known exactly."""

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud import SurfaceMesh

Array = NDArray[np.float64]


def grid(n: int = 12, size: float = 2.0, height: Array | None = None, seed: int | None = None) -> SurfaceMesh:
    """(n + 1)^2 vertices over a square around the origin, z = `height` (else 0); with a seed, jittered in the plane."""
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n + 1), np.linspace(-size / 2, size / 2, n + 1))
    if seed is not None:
        rng = np.random.default_rng(seed)
        x[1:-1, 1:-1] += rng.uniform(-0.2, 0.2, (n - 1, n - 1)) * size / n
        y[1:-1, 1:-1] += rng.uniform(-0.2, 0.2, (n - 1, n - 1)) * size / n
    z = np.zeros_like(x) if height is None else height
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    return SurfaceMesh.of(np.c_[x.ravel(), y.ravel(), z.ravel()], np.r_[np.c_[a, b, c], np.c_[a, c, d]])


def sphere(times: int = 3, radius: float = 1.0) -> SurfaceMesh:
    """An icosahedron, each triangle cut in four `times` times, all vertices on the sphere."""
    g = (1 + 5**0.5) / 2
    points = np.array([[0, s, t * g] for s in (-1, 1) for t in (-1, 1)], np.float64)
    points = np.concatenate([points, points[:, [2, 0, 1]], points[:, [1, 2, 0]]])
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = (distance < 2.1) & (distance > 0)
    faces = np.array(
        [[i, j, k] for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    )
    for _ in range(times):
        a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
        corners = np.stack([a, (a + b) / 2, (c + a) / 2, b, (b + c) / 2, c], axis=1).reshape(-1, 3)
        points, inverse = np.unique(corners.round(12), axis=0, return_inverse=True)
        f = inverse.reshape(-1, 6)
        faces = np.concatenate([f[:, [0, 1, 2]], f[:, [1, 3, 4]], f[:, [2, 4, 5]], f[:, [1, 4, 2]]])
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * radius
    inward = np.einsum(
        "ni,ni->n", np.cross(*(points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))), points[faces[:, 0]]
    )
    faces[inward < 0] = faces[inward < 0][:, [0, 2, 1]]
    return SurfaceMesh.of(points, faces)


def on_faces(surface: SurfaceMesh, faces: NDArray[np.int64], seed: int) -> Array:
    """A point inside each of `faces`."""
    weights = np.random.default_rng(seed).dirichlet([2.0, 2.0, 2.0], len(faces))
    return np.asarray(np.einsum("nk,nki->ni", weights, surface.corners[faces]))


def distance_to(surface: SurfaceMesh, face: int, point: Array) -> float:
    """From a point to a triangle: 0 inside."""
    a, b, c = surface.corners[face]
    weights, *_ = np.linalg.lstsq(np.c_[b - a, c - a], point - a, rcond=None)
    u, v = np.clip(weights, 0, None)
    total = max(u + v, 1.0)
    return float(np.linalg.norm(a + (b - a) * u / total + (c - a) * v / total - point))


def cylinder(radius: float = 1.0, length: float = 4.0, n: int = 48) -> SurfaceMesh:
    """Along x, around the origin."""
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    steps = np.linspace(-length / 2, length / 2, n + 1)
    points = np.array([[x, radius * np.sin(t), radius * np.cos(t)] for x in steps for t in turn])
    at = np.arange((n + 1) * n).reshape(n + 1, n)
    a, b = at[:-1], at[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return SurfaceMesh.of(points, np.r_[np.c_[a.ravel(), b.ravel(), c.ravel()], np.c_[a.ravel(), c.ravel(), d.ravel()]])
