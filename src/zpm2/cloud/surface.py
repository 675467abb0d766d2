"""A triangle mesh prepared for casting rays and tracing paths: cleaned, with neighbours, and near the origin."""

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
LARGEST_COORDINATE = 1e60  # units of the mesh; areas of larger triangles would overflow
DEGENERATE_AREA = 1e-12  # share of the squared extent; triangles with less area are left out


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """n vertices and m triangles. Coordinates are relative to `origin`, so that large ones (UTM) keep precision."""

    vertices: Array  # (n, 3)
    faces: Indices  # (m, 3)
    neighbors: Indices  # (m, 3) the face across the edge from corner k to corner k + 1; -1 at a border
    origin: Array  # (3,) subtracted from the coordinates of the file
    notes: tuple[str, ...] = ()  # what a user should know about the mesh
    filled: int = 0  # the last `filled` triangles fill holes (`holes.fill_holes`)

    __repr__ = brief

    @cached_property
    def corners(self) -> Array:
        """(m, 3, 3) coordinates of the three corners of each triangle."""
        return self.vertices[self.faces]

    @cached_property
    def normals(self) -> Array:
        """(m, 3) unit normals; the order of the corners gives their side."""
        across = crosses(self.corners)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300))

    @cached_property
    def areas(self) -> Array:
        """(m,) areas of the triangles."""
        return np.asarray(np.linalg.norm(crosses(self.corners), axis=1) / 2)

    @property
    def extent(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @staticmethod
    def of(vertices: ArrayLike, faces: ArrayLike, name: str = "mesh") -> "SurfaceMesh":
        """A clean mesh from vertices (n, 3) and triangles (m, 3).

        Vertices at the same place are merged. Triangles without area, with vertices that are not finite, and repeated
        ones are left out; a note counts each kind. The origin is the centre of the bounding box. Edges of more than two
        triangles count as borders of all of them; a note says so. `InputError` for arrays that are not a mesh, and if
        no triangle is left.
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
            raise InputError(f"{name} has triangles that refer to missing vertices: export it again")
        notes = []
        finite = np.asarray((np.abs(points) <= LARGEST_COORDINATE).all(1))  # False for NaN, too
        usable = finite[triangles].all(1)
        unusable = int((~usable).sum())
        notes += _counted(unusable, "triangles were left out: a vertex is not finite or too far away")

        triangles = triangles[usable]
        if len(triangles) == 0:
            raise InputError(f"{name} has no triangle with finite vertices: export it again")
        points, triangles = _compact(points, triangles)
        origin = (points.min(0) + points.max(0)) / 2
        points = points - origin
        flat = np.linalg.norm(crosses(points[triangles]), axis=1) / 2 <= DEGENERATE_AREA * float(
            np.ptp(points, axis=0) @ np.ptp(points, axis=0)
        )
        notes += map(Note, _counted(int(flat.sum()), "triangles were left out: they have no area"))
        triangles = triangles[~flat]
        _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
        notes += map(Note, _counted(len(triangles) - len(first), "triangles were left out: they are repeated"))
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
        """A mesh from a PLY, OBJ, OFF, STL or GLB file. STL and GLB need the package trimesh (extra `cloud`).

        Faces with more than three corners are cut into triangles (`facets.triangulate`). `InputError` for a file that
        cannot be read, and for a point cloud.
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
    """The package trimesh. `MissingDependency` if it is not installed."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingDependency('polygon clouds need trimesh: pip install "zpm2[cloud]"') from error
    return trimesh


def _compact(points: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The mesh without unused vertices, and with vertices at exactly the same place merged."""
    used, inverse = np.unique(triangles, return_inverse=True)
    distinct, same = np.unique(points[used] + 0.0, axis=0, return_inverse=True)
    return distinct, same.ravel()[inverse.ravel()].reshape(triangles.shape)


def crosses(corners: Array) -> Array:
    """(m, 3) normals of triangles (m, 3, 3), oriented by the order of the corners; their length is twice the area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.asarray(np.cross(b - a, c - a))


def paired_edges(triangles: Indices) -> tuple[Indices, Indices, int]:
    """(k,) and (k,): the two sides of each edge that exactly two triangles share; and how many edges have more.

    A side is 3 times the index of its triangle plus the corner where it starts.
    """
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (triangles.max() + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    two = first[count == 2]
    return order[two], order[two + 1], int((count > 2).sum())


def neighbors_of(triangles: Indices) -> tuple[Indices, int, int]:
    """(m, 3) neighbours; how many edges have more than two triangles; how many join opposite orientations."""
    one, other, crowded = paired_edges(triangles)
    neighbors = np.full(triangles.size, -1, np.int64)
    neighbors[one], neighbors[other] = other // 3, one // 3
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    forward = start < end
    return neighbors.reshape(-1, 3), crowded, int((forward[one] == forward[other]).sum())


def _counted(count: int, text: str) -> list[str]:
    """A list with the sentence; empty if the count is 0."""
    return [f"{count} {text}"] if count else []
