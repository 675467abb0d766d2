"""What pictures and pages of a polygon cloud show: the surface in grey, patches above it, boundaries as tubes.

These positions are for display only. Patches float a little above the surface, and nested patches above the ones around
them, so that nothing flickers. Surface far from all patches is left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.cloud.export import BOUNDARY_SHADE, TUBE_RADIUS, tubes
from zpm2.cloud.patch import SurfacePatch
from zpm2.cloud.result import PolygonCloud
from zpm2.cloud.surface import crosses

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Colors = NDArray[np.uint8]
# share of the extent: height of each layer above the one below, with all triangles and with fewer
LAYER_HEIGHT, COARSE_LAYER_HEIGHT = 4e-4, 8e-4
MIN_COMMON = 0.02  # share of a patch's area: patches that overlap less may lie in one layer
FULLY_COVERED = 0.999  # share of a triangle of the surface: if patches cover more, it is not shown
SHOWN_RADIUS = 0.75  # share of the extent: surface farther from the centre is not shown
MIN_PATCH_FACES = 20  # triangles that a simplified patch keeps at least
SURFACE_COLOR = (206, 206, 206)
NO_PATCH = -1  # stands for a patch's id where there is no patch


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """Triangles to show, in the surface's coordinates."""

    vertices: Array  # (n, 3)
    faces: Indices  # (m, 3)
    ids: Indices  # (m,) id of the patch of each triangle, or `NO_PATCH`
    colors: Colors  # (m, 3)
    tube: NDArray[np.bool_]  # (m,) whether each triangle belongs to a boundary's tube
    box: tuple[Array, Array]  # (3,) each: lowest and highest coordinates of most of what the photographs show
    up: Array  # (3,) unit vector
    towards: Array  # (3,) unit vector from the centre towards the views

    @property
    def center(self) -> Array:
        """(3,) centre of the box."""
        return np.asarray((self.box[0] + self.box[1]) / 2)

    @property
    def extent(self) -> float:
        """Diagonal of the box."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))


def display_mesh(cloud: PolygonCloud, max_faces: int | None = None) -> DisplayMesh:
    """The triangles that show a cloud.

    max_faces: about how many triangles the surface and the patches may have, each; None for all.
    """
    low, high = cloud.box
    height = LAYER_HEIGHT if max_faces is None else COARSE_LAYER_HEIGHT
    center, extent = (low + high) / 2, float(np.linalg.norm(high - low))
    around = _surface(cloud, center, SHOWN_RADIUS * extent, max_faces)
    parts = [(*around, NO_PATCH, np.array(SURFACE_COLOR, np.uint8), False)]

    total = sum(len(patch.patch.faces) for patch in cloud.patches)
    for polygon, rgb, layer in zip(cloud.patches, cloud.colors, _layers(cloud), strict=True):
        lift = layer * height * extent
        patch = polygon.patch
        normals = _vertex_normals(patch)
        floating = patch.vertices + lift * normals
        faces = patch.faces
        if max_faces is not None and total > max_faces:
            floating, faces = clustered(floating, faces, max(MIN_PATCH_FACES, max_faces * len(faces) // total))
        parts.append((floating, faces, polygon.id, rgb, False))
        tree, raised = cKDTree(patch.vertices), lift + height * extent / 2
        rings = [ring.points + raised * normals[tree.query(ring.points)[1]] for ring in polygon.rings]
        line = tubes(rings, TUBE_RADIUS * extent)
        parts.append((*line, polygon.id, (rgb * BOUNDARY_SHADE).astype(np.uint8), True))
    start = np.cumsum([0, *(len(v) for v, *_ in parts)])
    count = [len(f) for _, f, *_ in parts]
    towards = np.mean([_unit(view.camera.center - cloud.surface.origin - center) for view in cloud.views], axis=0)
    return DisplayMesh(
        vertices=np.concatenate([v for v, *_ in parts]),
        faces=np.concatenate([f + first for (_, f, *_), first in zip(parts, start, strict=False)]),
        ids=np.repeat([i for _, _, i, *_ in parts], count),
        colors=np.repeat(np.array([c for _, _, _, c, _ in parts]), count, axis=0),
        tube=np.repeat([t for *_, t in parts], count),
        box=(low, high),
        up=_unit(-np.sum([view.camera.rotation[1] for view in cloud.views], axis=0)),
        towards=_unit(towards),
    )


def clustered(vertices: Array, faces: Indices, max_faces: int) -> tuple[Array, Indices]:
    """A mesh simplified to about `max_faces` triangles: the vertices in each cell of a grid are replaced by their mean.

    Source: Rossignac and Borrel, Multi-resolution 3D approximations, 1993.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    area = float(np.linalg.norm(crosses(vertices[faces]), axis=1).sum() / 2)
    cell = (2 * area / max_faces) ** 0.5
    key = np.floor((vertices - vertices.min(0)) / cell).astype(np.int64)
    _, of, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    of = of.ravel()
    means = np.stack([np.bincount(of, vertices[:, k]) for k in range(3)], axis=1) / count[:, None]
    fewer = of[faces]
    real = (fewer != np.roll(fewer, -1, axis=1)).all(1)
    _, first = np.unique(np.sort(fewer[real], axis=1), axis=0, return_index=True)
    return means, fewer[real][np.sort(first)]


def _surface(cloud: PolygonCloud, center: Array, radius: float, max_faces: int | None) -> tuple[Array, Indices]:
    """The surface without the triangles that patches cover, so that patches are visible from behind, too."""
    surface = cloud.surface
    covered = np.asarray(cloud.covered_shares.sum(axis=0)).ravel()
    near = np.linalg.norm(surface.vertices - center, axis=1) < radius
    faces = surface.faces[near[surface.faces].all(1) & (covered < FULLY_COVERED)]
    used, inverse = np.unique(faces, return_inverse=True)
    vertices, faces = surface.vertices[used], inverse.reshape(-1, 3)
    return (vertices, faces) if max_faces is None else clustered(vertices, faces, max_faces)


def _vertex_normals(patch: SurfacePatch) -> Array:
    """(n, 3) unit normal of each vertex: the mean of those of the triangles around it, weighted by area."""
    across = np.repeat(patch.normals * patch.areas[:, None], 3, axis=0)
    corner, n = patch.faces.ravel(), len(patch.vertices)
    sums = np.stack([np.bincount(corner, across[:, k], n) for k in range(3)], axis=1)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))


def _layers(cloud: PolygonCloud) -> list[int]:
    """The number of layers below each patch: one more than below any larger patch that it partly covers."""
    covers = cloud.covered_shares
    both = (covers @ covers.multiply(cloud.surface.areas).T.tocsr()).tocsr()
    layer: list[int] = []
    for k, patch in enumerate(cloud.patches):  # by descending area
        row = slice(both.indptr[k], both.indptr[k + 1])
        under = both.indices[row][both.data[row] > MIN_COMMON * patch.patch.area]
        layer.append(1 + max((layer[j] for j in under if j < k), default=0))
    return layer


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))
