"""A scene of two textured planes, seen twice, with exact polygons: a background and a foreground that moves on its own.

Both planes are displaced along the rows only, so that the epipolar lines are the rows. Right polygons are the left ones
moved, jittered and renumbered; background polygons that the foreground hides in the right view are left out there.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from shapes import star

from zpm2 import geometry
from zpm2.model import Image, PointMatches, Polygon, PolygonArrays

CELL = 64  # px, one polygon in each
COLUMNS, ROWS = 10, 7
SIZE = COLUMNS * CELL, ROWS * CELL  # width, height
FRONT = (5, 2, 8, 5)  # cells of the foreground: first column, first row, end column, end row
CORNER = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # to OpenCV's pixel centres at 0


@dataclass(frozen=True)
class Scene:
    images: tuple[Image, Image]
    polygons: tuple[PolygonArrays, PolygonArrays]
    points: PointMatches
    truth: dict[int, int]  # left id -> right id
    front: set[int]  # left ids of the foreground


def scene(disparity=40.0, seed=0, per_cell=14, wrong=0.15, jitter=0.4, noise=2.0):
    """`disparity` px: how much further than the background the foreground moves."""
    rng = np.random.default_rng(seed)
    maps = [np.array([[1.01, 0.02, -22.0 - more], [0, 1, 0], [0, 0, 1]]) for more in (0.0, disparity)]
    texture = cv2.GaussianBlur(rng.normal(0, 1, (SIZE[1], SIZE[0])).astype(np.float32), (0, 0), 1.8)
    texture = 128 + 40 * texture / texture.std()
    x0, y0, x1, y1 = (CELL * side for side in FRONT)
    hidden = shapely.Polygon(geometry.project(maps[1], np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)))
    right = warp(texture, maps[0])
    in_front = np.zeros(texture.shape, np.float32)
    in_front[y0:y1, x0:x1] = 1
    right = np.where(warp(in_front, maps[1]) > 0.5, warp(texture, maps[1]), right)
    images = (
        image(texture + rng.normal(0, noise, texture.shape)),
        image(0.8 * right + 25 + rng.normal(0, noise, texture.shape)),
    )

    left_polygons, moved, front = [], {}, set()
    xy, uv = [], []
    for k, (row, column) in enumerate(np.ndindex(ROWS, COLUMNS)):
        near = FRONT[0] <= column < FRONT[2] and FRONT[1] <= row < FRONT[3]
        center = CELL * (np.array([column, row]) + 0.5)
        ring = star(rng, int(rng.integers(7, 14)), center, 0.48 * CELL)
        left_polygons.append(Polygon(k, ring))
        at = center + rng.uniform(-0.45, 0.45, (per_cell, 2)) * CELL
        to = geometry.project(maps[near], at)
        seen = near | ~shapely.contains_xy(hidden, to)
        xy.append(at[seen])
        uv.append(to[seen] + rng.normal(0, 0.3, (int(seen.sum()), 2)))
        target = geometry.project(maps[near], ring)
        if near:
            front.add(k)
        elif shapely.Polygon(target).intersects(hidden):
            continue
        if target.min() >= 0 and (target <= SIZE).all():
            moved[k] = target + rng.normal(0, jitter, target.shape)
    ids = dict(zip(moved, (500 + rng.permutation(len(moved))).tolist(), strict=True))
    right_polygons = [Polygon(ids[k], ring) for k, ring in sorted(moved.items(), key=lambda item: ids[item[0]])]
    points = PointMatches(np.concatenate(xy), np.concatenate(uv), np.ones(sum(map(len, xy))))
    outlier = rng.random(len(points)) < wrong
    points.right[outlier] = rng.uniform((0, 0), SIZE, (int(outlier.sum()), 2))
    return Scene(images, (PolygonArrays(left_polygons), PolygonArrays(right_polygons)), points, ids, front)


def warp(gray, matrix):
    return cv2.warpPerspective(
        gray, CORNER @ matrix @ np.linalg.inv(CORNER), SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


def image(gray):
    return Image(np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2))
