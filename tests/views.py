"""Two calibrated views of scenes that are known exactly, with regions: boxes of a grid in the left image."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.errors import Failed
from zpm2.model import Camera, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult

Array = NDArray[np.float64]
SIZE = (800, 600)
CELLS = (4, 3)


@dataclass(frozen=True, eq=False)
class Views:
    """n points of a scene in both cameras."""

    cameras: tuple[Camera, Camera]
    rotation: Array  # (3, 3)
    translation: Array  # (3,), any length
    world: Array  # (n, 3) in the left camera's frame
    points: PointMatches  # px

    @property
    def rays(self) -> tuple[Array, Array]:
        return self.cameras[0].rays(self.points.left), self.cameras[1].rays(self.points.right)

    @property
    def direction(self) -> Array:
        return np.asarray(self.translation / np.linalg.norm(self.translation))


def rotation(*angles: float) -> Array:
    """(3, 3) about the axis of `angles`, by their length, degrees."""
    return np.asarray(cv2.Rodrigues(np.radians(angles))[0])


def camera(focal: float = 700.0, **more: object) -> Camera:
    return Camera(np.array([[focal, 0, 410.5], [0, focal + 5, 290.5], [0, 0, 1]]), SIZE, **more)  # type: ignore[arg-type]


def views(
    seed: int = 0,
    n: int = 300,
    noise: float = 0.0,
    outliers: float = 0.0,
    scene: str = "deep",
    turn: Array | None = None,
    shift: tuple[float, float, float] = (-1.0, 0.1, 0.2),
    cameras: tuple[Camera, Camera] | None = None,
) -> Views:
    """scene: "deep" has points at 4 to 12 units of depth, "plane" on one slanted plane. `noise` px, `outliers` 0..1."""
    rng = np.random.default_rng(seed)
    turn = rotation(2.0, 10.0, -3.0) if turn is None else turn
    left, right = cameras or (camera(), camera(650.0))
    rays = left.rays(rng.uniform([20, 20], [SIZE[0] - 20, SIZE[1] - 20], (4 * n, 2)))
    depth = rng.uniform(4, 12, 4 * n) if scene == "deep" else 8.0 / (1 + 0.3 * rays[:, 0] - 0.2 * rays[:, 1])
    world = np.c_[rays, np.ones(len(rays))] * depth[:, None]
    there = world @ turn.T + np.array(shift)
    seen = there[:, 2] > 0.5
    world, there = world[seen], there[seen]
    a, b = left.pixels(world[:, :2] / world[:, 2:]), right.pixels(there[:, :2] / there[:, 2:])
    inside = np.flatnonzero(((b > 0) & (b < SIZE)).all(1))[:n]
    world, a, b = world[inside], a[inside], b[inside]
    a, b = a + rng.normal(0, noise, a.shape), b + rng.normal(0, noise, b.shape)
    wrong = rng.random(len(b)) < outliers
    b[wrong] = rng.uniform([0, 0], SIZE, (int(wrong.sum()), 2))
    return Views((left, right), turn, np.array(shift), world, PointMatches(a, b, rng.uniform(0.2, 1, len(a))))


def matched(of: Views) -> MatchResult:
    """A result whose matches are cells of a grid in the left image and the hulls of their points in the right one."""
    step = np.array(SIZE) / CELLS
    cell = (of.points.left // step).astype(int)
    lefts, rights, matches = [], [], []
    for k in range(CELLS[0] * CELLS[1]):
        corner = np.array([k % CELLS[0], k // CELLS[0]])
        inside = of.points.right[(cell == corner).all(1)]
        if len(inside) < 4:
            continue
        low, high = corner * step, (corner + 1) * step
        lefts.append(Polygon(k, np.array([low, [high[0], low[1]], high, [low[0], high[1]]])))
        hull = cv2.convexHull(inside.astype(np.float32))[:, 0].astype(np.float64)
        hull = hull.mean(0) + (hull - hull.mean(0)) * 1.05
        area = hull[:, 0] @ np.roll(hull[:, 1], -1) - hull[:, 1] @ np.roll(hull[:, 0], -1)
        rights.append(Polygon(100 + k, hull if area > 0 else hull[::-1]))
        matches.append(PolygonMatch(k, 100 + k, 0.9, 1.0, len(inside), "global", 0.8))
    sides = ImagePolygons(*SIZE, lefts), ImagePolygons(*SIZE, rights)
    unknown = Failed("not asked for")
    return MatchResult(*sides, matches, of.points, unknown, unknown, {}, {})


def angle(a: Array, b: Array) -> float:
    """Degrees between two rotations (3, 3), or two directions (3,)."""
    if a.ndim == 2:
        return float(np.degrees(np.linalg.norm(cv2.Rodrigues(a @ b.T)[0])))
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
