"""Renders the still life for a rectified camera pair, with exact disparity, occlusion and labels."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.evaluate.rendered.still_life import still_life
from zpm2.evaluate.rendered.surfaces import Points, RenderedSurface, Values
from zpm2.evaluate.rendered.textures import Texture

PITCH = 0.27  # rad, both cameras look down by this angle
EYE = np.array([-0.1, 1.55, 0.0])  # m, the left camera in room coordinates
BASELINE = 0.2  # m
FOCAL = 0.75  # focal length / image width
LIGHTMAP = 0.04  # m, spacing of the points at which the light is computed
SUN = np.array([0.86, 0.82, 0.75])  # colour of the window's light
SKY = np.array([0.56, 0.58, 0.62])  # colour of the light from the upper hemisphere
BOUNCE = np.array([0.21, 0.21, 0.2])  # colour of the light that reaches every point, even in corners
NOISE = 1.5  # grey levels, standard deviation
GAIN = 1.06  # by which the right photograph is brighter: it is exposed longer


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """A rendered pair. Left (x, y) and right (x - d, y) show the same scene point; pixel centres are at +0.5."""

    left: NDArray[np.uint8]  # (h, w, 3) RGB
    right: NDArray[np.uint8]  # (h, w, 3) RGB
    disparity: NDArray[np.float32]  # (h, w) px, at the pixel centres of the left image
    disparity_right: NDArray[np.float32]  # (h, w) px, at those of the right image: x_left = x_right + d
    occluded: NDArray[np.bool_]  # (h, w) left pixels whose scene point the right camera does not see
    occluded_right: NDArray[np.bool_]  # (h, w) right pixels whose scene point the left camera does not see
    labels: NDArray[np.uint16]  # (h, w) number of the surface that a left pixel shows, from 1 on
    labels_right: NDArray[np.uint16]  # (h, w) the same for the right image
    f: float  # px, focal length
    baseline: float  # m; depth = f baseline / disparity
    cx: float  # px, principal point, pixel centres at +0.5
    cy: float  # px


@dataclass(frozen=True, eq=False)
class _Camera:
    """A pinhole camera of the pair. A ray's parameter t is the depth along the optical axis, m."""

    position: NDArray[np.float64]  # (3,) m
    f: float  # px
    cx: float  # px
    cy: float  # px

    def rays(self, x: Values, y: Values) -> Points:
        """(3, n) directions, room coordinates, through the image points x, y."""
        right, down = (x - self.cx) / self.f, (y - self.cy) / self.f
        cos, sin = np.array([np.cos(PITCH), np.sin(PITCH)], x.dtype)
        return np.stack([right, -cos * down - sin, cos - sin * down])

    def window(self, surface: RenderedSurface) -> tuple[float, float, float, float]:
        """The image rectangle x0, y0, x1, y1 (px) that contains all that is seen of the surface."""
        x, y, z = surface.corners() - self.position[:, None]
        depth = np.cos(PITCH) * z - np.sin(PITCH) * y
        if depth.min() <= 0.05:
            return -np.inf, -np.inf, np.inf, np.inf
        u = self.cx + self.f * x / depth
        v = self.cy - self.f * (np.cos(PITCH) * y + np.sin(PITCH) * z) / depth
        return float(u.min()), float(v.min()), float(u.max()), float(v.max())


def render_scene(seed: int = 0, width: int = 960, height: int = 540) -> RenderedScene:
    """The pair that `zpm2 demo` matches: ray casting with 2 x 2 rays a pixel. The same seed gives the same pair."""
    rng = np.random.default_rng(seed)
    surfaces = still_life(rng)
    lights = _light(surfaces, np.random.default_rng(seed))
    f, cx, cy = FOCAL * width, width / 2, height / 2
    left = _Camera(EYE, f, cx, cy)
    right = _Camera(EYE + np.array([BASELINE, 0.0, 0.0]), f, cx, cy)
    x, y = _grid(width, height, 1, np.float64)
    images, disparities, occlusions, labels = [], [], [], []
    for camera, other, sign in ((left, right, -1), (right, left, 1)):
        colors = _photograph(surfaces, lights, camera, width, height) * (GAIN if camera is right else 1)
        colors = colors + NOISE * rng.standard_normal(colors.shape, np.float32)
        images.append(np.clip(np.rint(colors), 0, 255).astype(np.uint8))
        depth, index = _cast(surfaces, camera, x, y)
        disparity = f * BASELINE / depth
        seen_at = x + sign * disparity
        nearest, _ = _cast(surfaces, other, seen_at, y)
        visible = (nearest > depth * (1 - 1e-6)) & (seen_at >= 0) & (seen_at < width)
        disparities.append(disparity.reshape(height, width).astype(np.float32))
        occlusions.append(~visible.reshape(height, width))
        labels.append((index + 1).reshape(height, width).astype(np.uint16))
    return RenderedScene(
        left=images[0],
        right=images[1],
        disparity=disparities[0],
        disparity_right=disparities[1],
        occluded=occlusions[0],
        occluded_right=occlusions[1],
        labels=labels[0],
        labels_right=labels[1],
        f=f,
        baseline=BASELINE,
        cx=cx,
        cy=cy,
    )


def _grid(width: int, height: int, times: int, dtype: type[np.floating]) -> tuple[Values, Values]:
    """x and y (n,) of `times` x `times` points in each pixel, row by row."""
    x, y = ((np.arange(n * times) + 0.5).astype(dtype) / times for n in (width, height))
    return np.tile(x, len(y)), np.repeat(y, len(x))


def _cast(
    surfaces: Sequence[RenderedSurface], camera: _Camera, x: Values, y: Values
) -> tuple[Values, NDArray[np.int16]]:
    """(n,) depth (m) and number of the surface seen at each image point. `y` must be sorted in ascending order."""
    rays = camera.rays(x, y)
    origin = camera.position.astype(x.dtype)[:, None]
    depth = np.full(len(x), np.inf, x.dtype)
    index = np.full(len(x), -1, np.int16)
    for k, surface in enumerate(surfaces):
        x0, y0, x1, y1 = camera.window(surface)
        first, last = np.searchsorted(y, [y0, y1])
        rows = first + np.flatnonzero((x[first:last] >= x0) & (x[first:last] <= x1))
        t = surface.hit(origin, rays[:, rows])
        closer = t < depth[rows]
        depth[rows[closer]] = t[closer]
        index[rows[closer]] = k
    return depth, index


def _photograph(
    surfaces: Sequence[RenderedSurface], lights: Sequence[NDArray[np.float32]], camera: _Camera, width: int, height: int
) -> NDArray[np.float32]:
    """(height, width, 3) RGB, 0..255: the mean of 2 x 2 rays a pixel."""
    x, y = _grid(width, height, 2, np.float32)
    depth, index = _cast(surfaces, camera, x, y)
    points = camera.position.astype(np.float32)[:, None] + depth * camera.rays(x, y)
    colors = np.zeros((len(x), 3), np.float32)
    order = np.argsort(index, kind="stable")
    bounds = np.searchsorted(index[order], np.arange(len(surfaces) + 1))
    for k, surface in enumerate(surfaces):
        rows = order[bounds[k] : bounds[k + 1]]
        if len(rows):
            u, v = surface.locate(points[:, rows])
            colors[rows] = _sample(surface.texture, u, v) * _sample(lights[k], u, v)
    return np.asarray(colors.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)), np.float32)


def _sample(texture: Texture | NDArray[np.float32], u: Values, v: Values) -> NDArray[np.float32]:
    """(n, 3) bilinear values of a texture whose outer corners are u, v = 0 and 1."""
    h, w = texture.shape[:2]
    out = np.empty((len(u), 3), np.float32)
    for start in range(0, len(u), 30000):  # cv2.remap takes no side longer than 32767
        rows = slice(start, start + 30000)
        x, y = (u[rows] * w - 0.5).astype(np.float32), (v[rows] * h - 0.5).astype(np.float32)
        out[rows] = cv2.remap(texture, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
    return out


def _light(surfaces: Sequence[RenderedSurface], rng: np.random.Generator) -> list[NDArray[np.float32]]:
    """For each surface, an (h, w, 3) map of the light that falls on it; 1 shows the texture in its own colour.

    A window, in front of the scene on the left, casts soft shadows. Light also comes from the upper hemisphere. Objects
    near by block it, which darkens corners and the places where objects touch.
    """
    points, normals, shapes = [], [], []
    for surface in surfaces:
        low, high = surface.corners().min(1), surface.corners().max(1)
        n = int(np.clip(np.linalg.norm(high - low) / LIGHTMAP, 6, 128))
        u, v = ((np.arange(n) + 0.5) / n for _ in range(2))
        p, q = surface.place(np.tile(u, n), np.repeat(v, n))
        points.append((p + 0.01 * q).astype(np.float32))
        normals.append(q.astype(np.float32))
        shapes.append((n, n))
    start, normal = np.concatenate(points, axis=1), np.concatenate(normals, axis=1)
    spheres = [_sphere(surface, start) for surface in surfaces]
    light = np.tile(BOUNCE.astype(np.float32), (start.shape[1], 1))
    window = np.array([-0.5, 0.75, -0.95]) + rng.uniform(-0.13, 0.13, (10, 3))
    sky = rng.standard_normal((14, 3))
    sky[:, 1] = np.abs(sky[:, 1])
    for directions, reach, color in ((window, np.inf, SUN), (sky, 0.7, SKY)):
        for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
            ray = direction.astype(np.float32)
            facing = ray @ normal
            if reach < np.inf:
                facing = 0.5 + 0.5 * facing  # light from a hemisphere also reaches surfaces that face away
            free = _free(surfaces, spheres, start, ray, reach, facing > 0)
            light += (facing * free)[:, None] * color.astype(np.float32) / len(directions)
    parts = np.split(light, np.cumsum([h * w for h, w in shapes])[:-1])
    return [cv2.GaussianBlur(part.reshape(h, w, 3), (3, 3), 0) for part, (h, w) in zip(parts, shapes, strict=True)]


def _sphere(surface: RenderedSurface, start: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, Values]:
    """Centre (3, 1) and radius of a sphere around a surface, and the squared distance (n,) of each point from it."""
    corners = surface.corners().astype(np.float32)
    center = corners.mean(axis=1, keepdims=True)
    radius = float(np.linalg.norm(corners - center, axis=0).max())
    return center, radius, ((start - center) ** 2).sum(axis=0)


def _free(
    surfaces: Sequence[RenderedSurface],
    spheres: Sequence[tuple[NDArray[np.float32], float, Values]],
    start: NDArray[np.float32],
    ray: NDArray[np.float32],
    reach: float,
    wanted: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """(n,) which of the `wanted` points have no surface within `reach` m in the direction `ray`."""
    free = wanted.copy()
    passed = ray @ start
    for surface, (center, radius, distance) in zip(surfaces, spheres, strict=True):
        ahead = ray @ center - passed
        off = distance - ahead**2
        rows = np.flatnonzero(free & (ahead > -radius) & (ahead < reach + radius) & (off < radius**2))
        free[rows] = surface.hit(start[:, rows], ray[:, None]) >= reach
    return free
