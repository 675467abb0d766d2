"""A polygon cloud from three viewpoints, drawn by casting rays: no display and no graphics library."""

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.rays import open_caster
from zpm2.cloud.scene import SURFACE, Scene
from zpm2.cloud.surface import Surface
from zpm2.errors import Failed
from zpm2.model import Camera, PosedCamera

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
SIZE = 640, 560  # px of one view
FINER = 2  # rays along each side of a pixel
ANGLES = (-40.0, 0.0, 40.0)  # degrees around the up axis, from where the photographs were taken
ABOVE = 15.0  # degrees
OPENING = 40.0  # degrees of the field of view
MARGIN = 1.05
GAP = 6  # px


def three_views(scene: Scene) -> Pixels | Failed:
    """RGB, three views of a scene side by side. `Failed` where rays are slow (no Embree)."""
    mesh = Surface(scene.vertices, scene.faces, np.zeros((0, 3), np.int64), np.zeros(3))
    caster = open_caster(mesh)
    if caster.note:
        return Failed(caster.note)
    panels = []
    for angle in ANGLES:
        view = _view(scene, angle)
        width, height = view.camera.size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        directions = view.directions(np.c_[x.ravel(), y.ravel()])
        hits = caster.first_hits(np.broadcast_to(view.center, directions.shape), directions)
        face, found = hits.face[hits.found], hits.found
        sight = directions[found] / np.linalg.norm(directions[found], axis=1, keepdims=True)
        light = np.abs(np.einsum("ni,ni->n", mesh.normals[face], sight))
        light = np.where(scene.tube[face], 1.0, 0.45 + 0.55 * light)
        pixels = np.full((width * height, 3), 255.0)
        pixels[found] = scene.colors[face] * light[:, None]
        small: Pixels = cv2.resize(pixels.reshape(height, width, 3), SIZE, interpolation=cv2.INTER_AREA)
        panels += [np.rint(small).astype(np.uint8), np.full((SIZE[1], GAP, 3), 255, np.uint8)]
    return np.concatenate(panels[:-1], axis=1)


def _view(scene: Scene, angle: float) -> PosedCamera:
    """A camera that sees all patches, turned by `angle` around the up axis and a little higher than the views."""
    side = np.cross(scene.up, scene.towards)
    side /= max(float(np.linalg.norm(side)), 1e-12)
    direction = _turned(_turned(scene.towards, side, -ABOVE), scene.up, angle)
    back = -direction
    right = np.cross(back, scene.up)
    right /= max(float(np.linalg.norm(right)), 1e-12)
    rotation = np.stack([right, np.cross(back, right), back])
    width, height = SIZE[0] * FINER, SIZE[1] * FINER
    focal = 0.5 * height / np.tan(np.radians(OPENING / 2))
    patches = scene.vertices[np.unique(scene.faces[scene.ids != SURFACE])]
    shown = patches[((patches >= scene.box[0]) & (patches <= scene.box[1])).all(1)]
    shown = shown if len(shown) else scene.vertices
    x, y, z = rotation @ (shown - scene.center).T
    # the middle of what is seen, and as near as everything fits
    x0, y0 = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    reach = np.maximum(np.abs(x - x0) * 2 * focal / width, np.abs(y - y0) * 2 * focal / height)
    distance = float((MARGIN * reach - z).max())
    camera = Camera(np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]), (width, height))
    center = scene.center + rotation.T @ np.array([x0, y0, -distance])
    return PosedCamera(camera, rotation, -rotation @ center)


def _turned(vector: Array, axis: Array, degrees: float) -> Array:
    """A vector turned around a unit axis (Rodrigues)."""
    a = np.radians(degrees)
    return np.asarray(
        vector * np.cos(a) + np.cross(axis, vector) * np.sin(a) + axis * (axis @ vector) * (1 - np.cos(a))
    )
