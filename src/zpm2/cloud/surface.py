"""A triangle mesh, cleaned for casting rays and tracing paths: with neighbours, and near the origin."""

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zpm2.cloud.facets import triangulate
from zpm2.errors import InputError, MissingDependency
from zpm2.formats.meshes import read_mesh
from zpm2.model.brief import brief
from zpm2.model.messages import Note

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
FORMATS = (".ply", ".obj", ".stl", ".glb", ".off")
LARGEST_COORDINATE = 1e60  # units of the mesh: areas beyond cannot be computed
DEGENERATE_AREA = 1e-12  # of the squared extent: triangles of less area are left out


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """n vertices, m triangles. Coordinates are relative to `origin`, so that large ones (UTM) lose nothing."""

    vertices: Array  # (n, 3)
    faces: Indices  # (m, 3)
    neighbors: Indices  # (m, 3) the face across the edge from corner k to corner k + 1; -1 at a border
    origin: Array  # (3,) subtracted from the coordinates of the file
    notes: tuple[str, ...] = ()  # what a user should know about the mesh
    filled: int = 0  # how many of the triangles, the last ones, fill holes (`holes.fill_holes`)

    __repr__ = brief

    @cached_property
    def corners(self) -> Array:
        """(m, 3, 3) coordinates of the three corners of each triangle."""
        return self.vertices[self.faces]

    @cached_property
    def normals(self) -> Array:
        """(m, 3) unit normals, by the order of the corners."""
        across = crosses(self.corners)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300))

    @cached_property
    def areas(self) -> Array:
        """(m,) of the triangles."""
        return np.asarray(np.linalg.norm(crosses(self.corners), axis=1) / 2)

    @property
    def extent(self) -> float:
        """Length of the diagonal of the box around it."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @staticmethod
    def of(vertices: ArrayLike, faces: ArrayLike, name: str = "mesh") -> "SurfaceMesh":
        """A mesh made usable. Vertices at one place are merged. Triangles without area, with vertices that are not
        finite, and repeated ones are left out, each kind with a note. The origin is the middle of its box.

        Edges of more than two triangles are borders of all of these, with a note. `InputError` for arrays that are no
        mesh, and where nothing is left.
        """
        points, triangles = np.asarray(vertices, np.float64), np.asarray(faces)
        if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
            raise InputError(
                f"{name}: expected vertices (n, 3) and triangles (m, 3), got {points.shape} and {triangles.shape}"
            )
        if len(points) == 0 or len(triangles) == 0:
            raise InputError(f"{name} has {len(points)} vertices and {len(triangles)} triangles: there is no surface")
        triangles = triangles.astype(np.int64)
        if triangles.min() < 0 or triangles.max() >= len(points):
            raise InputError(f"{name} has triangles of vertices that it does not have: export it again")
        notes = []
        finite = np.asarray((np.abs(points) <= LARGEST_COORDINATE).all(1))  # False for NaN, too
        usable = finite[triangles].all(1)
        unusable = int((~usable).sum())
        notes += _counted(unusable, "triangles have a vertex that is not finite or too far, and were left out")

        triangles = triangles[usable]
        if len(triangles) == 0:
            raise InputError(f"{name} has no triangle with finite vertices: export it again")
        points, triangles = _compact(points, triangles)
        origin = (points.min(0) + points.max(0)) / 2
        points = points - origin
        flat = np.linalg.norm(crosses(points[triangles]), axis=1) / 2 <= DEGENERATE_AREA * float(
            np.ptp(points, axis=0) @ np.ptp(points, axis=0)
        )
        notes += map(Note, _counted(int(flat.sum()), "triangles have no area, and were left out"))
        triangles = triangles[~flat]
        _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
        notes += map(Note, _counted(len(triangles) - len(first), "triangles are repeated, and were left out"))
        triangles = triangles[np.sort(first)]
        if len(triangles) == 0:
            raise InputError(f"{name} has no triangle with an area: there is no surface")
        neighbors, crowded, flipped = neighbors_of(triangles)
        if crowded:
            notes.append(f"{crowded} edges belong to more than two triangles (not manifold): paths end there")
        if flipped:
            notes.append(f"{flipped} edges join triangles of opposite orientation: normals are not consistent")
        return SurfaceMesh(points, triangles, neighbors, origin, tuple(notes))

    @staticmethod
    def read(path: str | Path) -> "SurfaceMesh":
        """A mesh from a PLY, OBJ, OFF, STL or GLB file (the last two: package trimesh, the extra `cloud`).

        Faces of more than three corners are cut into triangles (`facets.triangulate`). `InputError` for what cannot be
        read and for a point cloud.
        """
        path = Path(path)
        if path.suffix.lower() not in FORMATS:
            raise InputError(f"{path}: meshes are read from {', '.join(FORMATS)} files")
        if not os.path.isfile(path):
            raise InputError(f"mesh {path} does not exist: check the path")
        notes: list[str] = []
        try:
            if path.suffix.lower() in (".ply", ".obj", ".off"):
                vertices, polygons = read_mesh(path)
                faces, notes = triangulate(vertices, polygons)
            else:
                mesh = require_trimesh().load(path, force="mesh", process=False)
                vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces).reshape(-1, 3)
        except MissingDependency:
            raise
        except Exception as error:  # the readers raise whatever their parsers do
            raise InputError(f"mesh {path} cannot be read: {' '.join(str(error).split()) or repr(error)}") from error
        if len(faces) == 0:
            count = len(vertices)
            what = f"is a point cloud, {count} points without faces" if count else "has no faces"
            raise InputError(
                f"mesh {path} {what}: a surface is needed; make one of the points (Poisson meshing, for example), or "
                "of the photographs with zpm2 reconstruct"
            )
        surface = SurfaceMesh.of(vertices, faces, f"mesh {path}")
        return replace(surface, notes=(*notes, *surface.notes))


def require_trimesh() -> ModuleType:
    """The package, or `MissingDependency`."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingDependency('polygon clouds need trimesh: pip install "zpm2[cloud]"') from error
    return trimesh


def _compact(points: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Only the vertices that are used, and those at exactly one place as one."""
    used, inverse = np.unique(triangles, return_inverse=True)
    distinct, same = np.unique(points[used] + 0.0, axis=0, return_inverse=True)
    return distinct, same.ravel()[inverse.ravel()].reshape(triangles.shape)


def crosses(corners: Array) -> Array:
    """(m, 3) normals of triangles (m, 3, 3), by the order of their corners, twice as long as the area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.asarray(np.cross(b - a, c - a))


def paired_edges(triangles: Indices) -> tuple[Indices, Indices, int]:
    """(k,) and (k,) the two sides of each edge of exactly two triangles (3 times the triangle plus the corner where the
    side starts), and how many edges have more."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (triangles.max() + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    two = first[count == 2]
    return order[two], order[two + 1], int((count > 2).sum())


def neighbors_of(triangles: Indices) -> tuple[Indices, int, int]:
    """(m, 3) neighbours, how many edges have more than two triangles, and how many join opposite orientations."""
    one, other, crowded = paired_edges(triangles)
    neighbors = np.full(triangles.size, -1, np.int64)
    neighbors[one], neighbors[other] = other // 3, one // 3
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    forward = start < end
    return neighbors.reshape(-1, 3), crowded, int((forward[one] == forward[other]).sum())


def _counted(count: int, text: str) -> list[str]:
    """The sentence, unless the count is 0."""
    return [f"{count} {text}"] if count else []
