"""The surfaces of the scene (rectangles, spheres, frusta), and where rays hit them.

Points and directions are (3, n) arrays in room coordinates, metres (x right, y up, z away from the cameras); u and v
run from 0 to 1 over a surface's texture, along its columns and down its rows.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.evaluate.rendered.textures import Texture

Points = NDArray[np.floating]  # (3, n) float32 or float64
Values = NDArray[np.floating]  # (n,) likewise


class RenderedSurface(Protocol):
    """A textured surface that rays can hit."""

    @property
    def texture(self) -> Texture: ...

    def hit(self, origin: Points, ray: Points) -> Values:
        """(n,) smallest t > 0 for which origin + t ray lies on the surface; infinity if there is none."""

    def locate(self, points: Points) -> tuple[Values, Values]:
        """(n,) u and v of points on the surface."""

    def place(self, u: Values, v: Values) -> tuple[Points, Points]:
        """The points at u and v, and the unit normals there."""

    def corners(self) -> Points:
        """(3, 8) corners of a box that contains the surface."""


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A rectangle spanned by two perpendicular edges, or the ellipse in it. It is visible and blocks light only from
    the side to which `normal` points."""

    corner: NDArray[np.float64]  # (3,) m, u = v = 0
    right: NDArray[np.float64]  # (3,) m, along u
    down: NDArray[np.float64]  # (3,) m, along v
    texture: Texture
    round: bool = False

    @cached_property
    def normal(self) -> NDArray[np.float64]:
        n = np.cross(self.right, self.down)
        return np.asarray(n / np.linalg.norm(n))

    def hit(self, origin: Points, ray: Points) -> Values:
        normal = self.normal.astype(ray.dtype)
        against = normal @ ray
        if against.min(initial=0) >= 0:
            return np.full(np.broadcast_shapes(origin.shape, ray.shape)[1], np.inf, ray.dtype)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (normal @ self.corner.astype(ray.dtype) - normal @ origin) / against
            u, v = self.locate(origin + t * ray)
            if self.round:
                inside = (u - 0.5) ** 2 + (v - 0.5) ** 2 <= 0.25
            else:
                inside = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        return np.where(inside & (t > 1e-6) & (against < 0), t, np.inf)

    def locate(self, points: Points) -> tuple[Values, Values]:
        along, across = ((e / (e @ e)).astype(points.dtype) for e in (self.right, self.down))
        corner = self.corner.astype(points.dtype)
        return along @ points - along @ corner, across @ points - across @ corner

    def place(self, u: Values, v: Values) -> tuple[Points, Points]:
        points = self.corner[:, None] + self.right[:, None] * u + self.down[:, None] * v
        return points, np.repeat(self.normal[:, None], len(u), axis=1)

    def corners(self) -> Points:
        return self.place(np.resize([0.0, 1.0], 8), np.resize([0.0, 0.0, 1.0, 1.0], 8))[0]


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere; the texture's top is at `axis`, its seam at the back."""

    center: NDArray[np.float64]  # (3,) m
    radius: float  # m
    axis: NDArray[np.float64]  # (3,) unit vector to the texture's pole
    texture: Texture

    def _frame(self) -> NDArray[np.float64]:
        """Rows: three perpendicular unit vectors, the last one the axis, the second one away from the cameras."""
        side = np.cross(self.axis, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        return np.stack([side, np.cross(side, self.axis), self.axis])

    def hit(self, origin: Points, ray: Points) -> Values:
        offset = origin - self.center.astype(ray.dtype)[:, None]
        a, b, c = (ray * ray).sum(0), (ray * offset).sum(0), (offset * offset).sum(0) - self.radius**2
        inside = b * b - a * c
        root = np.sqrt(np.maximum(inside, 0))
        t = (-b - root) / a
        return np.where((inside >= 0) & (t > 1e-6), t, np.inf)

    def locate(self, points: Points) -> tuple[Values, Values]:
        offset = points - self.center.astype(points.dtype)[:, None]
        x, back, up = self._frame().astype(points.dtype) @ (offset / self.radius)
        return np.arctan2(x, -back) / (2 * np.pi) + 0.5, np.arccos(np.clip(up, -1, 1)) / np.pi

    def place(self, u: Values, v: Values) -> tuple[Points, Points]:
        turn, tilt = (u - 0.5) * 2 * np.pi, v * np.pi
        local = np.stack([np.sin(turn) * np.sin(tilt), -np.cos(turn) * np.sin(tilt), np.cos(tilt)])
        normals = self._frame().T @ local
        return self.center[:, None] + self.radius * normals, normals

    def corners(self) -> Points:
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
        return self.center[:, None] + self.radius * signs


@dataclass(frozen=True, eq=False)
class Frustum:
    """The side of an upright cylinder or truncated cone; the texture goes around it, its seam at the back."""

    foot: NDArray[np.float64]  # (3,) m, centre of the lower rim
    height: float  # m
    lower: float  # m, radius of the lower rim
    upper: float  # m, radius of the upper rim
    texture: Texture

    def hit(self, origin: Points, ray: Points) -> Values:
        slope = (self.upper - self.lower) / self.height
        x, y, z = origin - self.foot.astype(ray.dtype)[:, None]
        dx, dy, dz = ray
        radius = self.lower + slope * y
        a = dx * dx + dz * dz - (slope * dy) ** 2
        b = x * dx + z * dz - slope * dy * radius
        c = x * x + z * z - radius**2
        inside = b * b - a * c
        root = np.sqrt(np.maximum(inside, 0))
        best = np.full(np.shape(inside), np.inf, ray.dtype)
        with np.errstate(divide="ignore", invalid="ignore"):
            for t in ((-b - root) / a, (-b + root) / a):
                level = y + t * dy
                ok = (inside >= 0) & (t > 1e-6) & (level >= 0) & (level <= self.height) & (t < best)
                best = np.where(ok, t, best)
        return best

    def locate(self, points: Points) -> tuple[Values, Values]:
        x, y, z = points - self.foot.astype(points.dtype)[:, None]
        return np.arctan2(x, -z) / (2 * np.pi) + 0.5, 1 - y / self.height

    def place(self, u: Values, v: Values) -> tuple[Points, Points]:
        turn = (u - 0.5) * 2 * np.pi
        radius = self.upper + (self.lower - self.upper) * v
        out = np.stack([np.sin(turn), np.full_like(u, (self.lower - self.upper) / self.height), -np.cos(turn)])
        points = np.stack([radius * out[0], (1 - v) * self.height, radius * out[2]]) + self.foot[:, None]
        return points, out / np.linalg.norm(out, axis=0)

    def corners(self) -> Points:
        radius = max(self.lower, self.upper)
        x, y, z = np.array(np.meshgrid([-radius, radius], [0, self.height], [-radius, radius])).reshape(3, -1)
        return np.asarray(self.foot[:, None] + np.stack([x, y, z]))


def box(
    foot: tuple[float, float, float], size: tuple[float, float, float], yaw: float, sides: Texture, top: Texture
) -> list[Rectangle]:
    """The five visible faces of a box whose base has the centre `foot`, turned by `yaw` radians about the vertical.

    size: width, height, depth, m.
    """
    width, height, depth = size
    across = np.array([np.cos(yaw), 0.0, np.sin(yaw)])
    away = np.array([-np.sin(yaw), 0.0, np.cos(yaw)])
    up = np.array([0.0, height, 0.0])
    center = np.array(foot)
    faces = []
    for out, along, half, length in (
        (-away, across, depth / 2, width),
        (across, away, width / 2, depth),
        (away, -across, depth / 2, width),
        (-across, -away, width / 2, depth),
    ):
        corner = center + out * half - along * length / 2 + up
        faces.append(Rectangle(corner, along * length, -up, sides))
    lid = center + up - across * width / 2 + away * depth / 2
    return [*faces, Rectangle(lid, across * width, -away * depth, top)]
