"""Cuts closed boundaries into the mesh: each polygon becomes a mesh of its own (paper 3.5.2, Definition and (4))."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from zpm2.cloud.lift import Lifted
from zpm2.cloud.surface import SurfaceMesh, crosses, paired_edges
from zpm2.errors import Failed
from zpm2.model import Camera, PosedCamera
from zpm2.polygons.repair import repaired

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SAME_CORNER = 1e-6  # px; a corner of a cut triangle that is nearer to a known point is that point
WORTH_HALVING = 40  # with more corners, and more triangles, it is faster to halve a polygon first
EDGE_ON = 1e-10  # px^2, twice the area; smaller triangles are seen edge-on and cannot be cut in the image


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """A piece of a surface: n vertices and m triangles, all facing the camera that saw it."""

    vertices: Array  # (n, 3) in the surface's coordinates
    faces: Indices  # (m, 3)
    source: Indices  # (m,) the triangle of the surface that each one is a part of

    @cached_property
    def _across(self) -> Array:
        """(m, 3) normals; their length is twice the area."""
        return crosses(self.vertices[self.faces])

    @cached_property
    def areas(self) -> Array:
        """(m,) areas of the triangles, in squared units of the mesh."""
        return np.asarray(np.linalg.norm(self._across, axis=1) / 2)

    @property
    def area(self) -> float:
        """Area of the whole patch, in squared units of the mesh."""
        return float(self.areas.sum())

    @cached_property
    def normals(self) -> Array:
        """(m, 3) unit normals, which face the camera: the normal field."""
        return self._across / np.maximum(2 * self.areas, 1e-300)[:, None]

    @cached_property
    def normal(self) -> Array:
        """(3,) mean of the normals, weighted by area and scaled to unit length."""
        total = self._across.sum(0)
        return np.asarray(total / max(float(np.linalg.norm(total)), 1e-300))

    @property
    def normal_spread(self) -> float:
        """Root mean square angle between the normals and their mean, weighted by area, in degrees."""
        angle = np.degrees(np.arccos(np.clip(self.normals @ self.normal, -1, 1)))
        return float(np.sqrt(np.average(angle**2, weights=self.areas)))

    @cached_property
    def centroid(self) -> Array:
        """(3,) centroid of the patch's area, in the surface's coordinates."""
        middles = self.vertices[self.faces].mean(1)
        return np.asarray(np.average(middles, axis=0, weights=self.areas))

    @cached_property
    def _spread(self) -> Array:
        """(3,) variances of the patch's area along its principal axes, ascending."""
        corners = self.vertices[self.faces] - self.centroid
        middle = corners.mean(1)
        # exact integral of x x^T over a triangle
        second = np.einsum("nki,nkj,n->ij", corners, corners, self.areas) / 12
        second += 9 * np.einsum("ni,nj,n->ij", middle, middle, self.areas) / 12
        return np.asarray(np.clip(np.linalg.eigvalsh(second / self.area), 0, None))

    @property
    def planarity(self) -> float:
        """1 for a plane, 0 for a patch that spreads equally in all directions.

        1 - 3 times the surface variation of Pauly, Gross and Kobbelt (Efficient simplification of point-sampled
        surfaces, 2002).
        """
        return float(1 - 3 * self._spread[0] / max(float(self._spread.sum()), 1e-300))

    @property
    def plane_distance(self) -> float:
        """Root mean square distance to the plane that fits best, in units of the mesh."""
        return float(np.sqrt(self._spread[0]))

    @cached_property
    def curvature(self) -> float:
        """Average mean curvature (k1 + k2) / 2 of the patch, in 1 / unit of the mesh; 1 / r on a sphere.

        Positive if the surface bulges towards the camera. Half the sum over inner edges of length times bending angle,
        divided by the area (Steiner).
        """
        one, other, _ = paired_edges(self.faces)
        start, end = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        along = self.vertices[end[one]] - self.vertices[start[one]]
        length = np.linalg.norm(along, axis=1)
        n, m = self.normals[one // 3], self.normals[other // 3]
        sine = np.einsum("ni,ni->n", np.cross(n, m), along) / np.maximum(length, 1e-300)
        bend = np.arctan2(sine, np.einsum("ni,ni->n", n, m))
        return float((length * bend).sum() / 2 / self.area)


class Cutter:
    """Cuts the lifted polygons of one view out of a surface."""

    def __init__(self, surface: SurfaceMesh, camera: PosedCamera) -> None:
        self.surface, self.camera = surface, camera
        pinhole = Camera(camera.camera.matrix, camera.camera.size)  # without distortion: edges stay straight
        self._pinhole = PosedCamera(pinhole, camera.rotation, camera.translation)
        self._pixels = self._pinhole.project(surface.vertices + surface.origin)  # (n, 2), NaN behind the camera
        self._visited = np.full(len(surface.faces), -1, np.int64)  # the last cut that visited each triangle
        self._cut = -1
        self._center = camera.center - surface.origin

    def cut(self, lifted: Lifted) -> SurfacePatch | Failed:
        """The piece of the surface that the boundary encloses.

        Triangles under the boundary are cut along it, in the image of the camera. The other triangles inside are found
        from neighbour to neighbour, so that surfaces hidden behind them are never included. Every point of the boundary
        is a vertex of the patch. `Failed` if the boundary encloses nothing.
        """
        surface = self.surface
        rings = [self._pinhole.project(ring.points + surface.origin) for ring in lifted.rings]
        shape = repaired(shapely.Polygon(rings[0], rings[1:]))
        if shape.area == 0:
            return Failed("its boundary encloses nothing")
        border = np.unique(np.concatenate([ring.faces for ring in lifted.rings]))
        border = border[border >= 0]
        whole = self._enclosed(shape, border)
        corner, local = np.unique(surface.faces[np.r_[whole, border]], return_inverse=True)
        local = local.reshape(-1, 3)
        known = np.concatenate([*rings, self._pixels[corner]])  # the boundary, then the surface's vertices
        first = len(known) - len(corner)
        in_border = np.zeros(len(corner), bool)
        in_border[local[len(whole) :]] = True
        near = np.r_[np.arange(first), first + np.flatnonzero(in_border)]
        cut, source, added = self._pieces(shape, border, known, near)
        faces = np.concatenate([local[: len(whole)] + first, cut])
        if len(faces) == 0:
            return Failed("its boundary encloses nothing")
        points = np.concatenate([*(ring.points for ring in lifted.rings), surface.vertices[corner], added])
        used, inverse = np.unique(faces, return_inverse=True)
        patch = _towards(self._center, points[used], inverse.reshape(-1, 3), np.r_[whole, source])
        return patch if patch.area > 0 else Failed("its boundary encloses nothing")

    def _enclosed(self, shape: shapely.Polygon, border: Indices) -> Indices:
        """The triangles inside that the boundary does not touch, found from the border inwards across shared edges."""
        shapely.prepare(shape)
        self._cut += 1
        self._visited[border] = self._cut
        inside, front = [np.zeros(0, np.int64)], border
        while len(front):
            corners = self._pixels[self.surface.faces[front]]
            middle = (corners + np.roll(corners, -1, axis=1)) / 2
            across = self.surface.neighbors[front]
            goes = (across >= 0) & (self._visited[across] != self._cut)
            goes[goes] = shapely.contains_xy(shape, middle[goes])
            front = np.unique(across[goes])
            self._visited[front] = self._cut
            inside.append(front)
        return np.concatenate(inside)

    def _pieces(
        self, shape: shapely.Polygon, border: Indices, known: Array, near: Indices
    ) -> tuple[Indices, Indices, Array]:
        """Cuts the triangles that the boundary touches, and returns their parts inside.

        Returns (k, 3) corners, which are rows of `known` followed by the added points; (k,) the triangle that each part
        belongs to; and (a, 3) the added points. known: px of the points that may be corners; near: rows of those that
        can occur here.
        """
        surface = self.surface
        seen = self._pixels[surface.faces[border]]
        across = np.diff(seen, axis=1)
        big = np.abs(across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0]) > EDGE_ON
        border, seen = border[big], seen[big]
        if len(border) == 0:
            return np.zeros((0, 3), np.int64), border, np.zeros((0, 3))
        inside = _inside(shape, seen)
        parts, of = shapely.get_parts(shapely.constrained_delaunay_triangles(inside), return_index=True)
        corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
        source = border[of]
        distance, at = cKDTree(known[near]).query(corners, distance_upper_bound=SAME_CORNER)
        new = ~np.isfinite(distance)
        row = np.where(new, 0, near[np.minimum(at, len(near) - 1)])
        row[new] = len(known) + np.arange(int(new.sum()))
        added = self._on_face(corners[new], np.repeat(source, 3)[new])
        rows = row.reshape(-1, 3)
        real = (rows != np.roll(rows, -1, axis=1)).all(1)
        return rows[real], source[real], added

    def _on_face(self, pixels: Array, face: Indices) -> Array:
        """(n, 3) points where the lines of sight through `pixels` meet the planes of the triangles `face`."""
        direction = self._pinhole.directions(pixels)
        normal = self.surface.normals[face]
        along = np.einsum("ni,ni->n", self.surface.corners[face, 0] - self._center, normal)
        return np.asarray(self._center + direction * (along / np.einsum("ni,ni->n", direction, normal))[:, None])


def _inside(shape: shapely.Polygon, triangles: Array) -> NDArray[np.object_]:
    """(k,) the part of each of the (k, 3, 2) triangles that lies inside a polygon.

    A boundary has thousands of corners, but each triangle meets only a few of them. So the polygon is halved again and
    again, and each triangle is cut with the smallest piece that contains it.
    """
    shapes, low, high = shapely.polygons(triangles), triangles.min(1), triangles.max(1)
    result = np.empty(len(triangles), object)

    def cut(piece: shapely.Geometry, rows: Indices) -> None:
        if piece.is_empty:
            result[rows] = piece
            return
        x0, y0, x1, y1 = shapely.bounds(piece)
        axis = int(y1 - y0 > x1 - x0)
        middle = float(np.median((low[rows, axis] + high[rows, axis]) / 2)) if len(rows) else 0.0
        first, second = rows[high[rows, axis] < middle], rows[low[rows, axis] > middle]
        if (
            len(rows) <= WORTH_HALVING
            or shapely.get_num_coordinates(piece) <= WORTH_HALVING
            or not len(first)
            or not len(second)
        ):
            result[rows] = shapely.intersection(shapes[rows], piece)
            return
        across = np.setdiff1d(rows, np.r_[first, second])
        result[across] = shapely.intersection(shapes[across], piece)
        halves = (
            ((x0, y0, middle, y1), (middle, y0, x1, y1)) if axis == 0 else ((x0, y0, x1, middle), (x0, middle, x1, y1))
        )
        for box, part in zip(halves, (first, second), strict=True):
            parts = shapely.get_parts(shapely.get_parts(shapely.intersection(piece, shapely.box(*box))))
            cut(shapely.MultiPolygon([p for p in parts if p.geom_type == "Polygon"]), part)

    cut(shape, np.arange(len(triangles)))
    return result


def _towards(center: Array, vertices: Array, faces: Indices, source: Indices) -> SurfacePatch:
    """A patch of these triangles, each oriented to face the camera's `center`."""
    corners = vertices[faces]
    facing = np.einsum("ni,ni->n", crosses(corners), center - corners[:, 0])
    away = facing < 0
    faces = np.where(away[:, None], faces[:, ::-1], faces)
    return SurfacePatch(vertices, faces, source)


def covered_shares(patches: Sequence[SurfacePatch], surface: SurfaceMesh) -> csr_array:
    """Sparse (p, m): the share of each triangle of the surface that each patch covers."""
    rows = np.repeat(np.arange(len(patches)), [len(p.faces) for p in patches])
    source = np.concatenate([np.zeros(0, np.int64), *(p.source for p in patches)])
    areas = np.concatenate([np.zeros(0), *(p.areas for p in patches)]) / surface.areas[source]
    return coo_array((areas, (rows, source)), shape=(len(patches), len(surface.faces))).tocsr()


def touching(patches: Sequence[SurfacePatch], surface: SurfaceMesh) -> dict[int, list[int]]:
    """For each patch, the other patches that share a triangle of the surface with it."""
    covers = covered_shares(patches, surface)
    common = (covers @ covers.T).tocoo()
    near: dict[int, list[int]] = {}
    for a, b in zip(common.row.tolist(), common.col.tolist(), strict=True):
        if a != b:
            near.setdefault(a, []).append(b)
    return near
