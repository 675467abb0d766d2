"""A polygon cloud from three viewpoints, drawn by casting rays. It needs no display and no graphics library."""

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.display_mesh import NO_PATCH, DisplayMesh
from zpm2.cloud.rays import open_caster
from zpm2.cloud.surface import SurfaceMesh
from zpm2.errors import Failed
from zpm2.model import Camera, PosedCamera

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
SIZE = 640, 560  # px of one view
SUPERSAMPLING = 2  # rays along each side of a pixel
AZIMUTHS = (-40.0, 0.0, 40.0)  # degrees around the up axis; 0 is the direction of the photographs
ELEVATION = 15.0  # degrees above the photographs
FIELD_OF_VIEW = 40.0  # degrees
MARGIN = 1.05  # times the distance at which everything fits
GAP = 6  # px, between the views
AMBIENT = 0.45  # brightness of a surface seen from the side


def three_views(shown_mesh: DisplayMesh) -> Pixels | Failed:
    """Three views of a cloud side by side, RGB. `Failed` without Embree, as casting rays would be too slow."""
    mesh = SurfaceMesh(shown_mesh.vertices, shown_mesh.faces, np.zeros((0, 3), np.int64), np.zeros(3))
    caster = open_caster(mesh)
    if caster.note:
        return Failed(caster.note)
    panels = []
    for angle in AZIMUTHS:
        view = _view(shown_mesh, angle)
        width, height = view.camera.size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        directions = view.directions(np.c_[x.ravel(), y.ravel()])
        hits = caster.first_hits(np.broadcast_to(view.center, directions.shape), directions)
        face, found = hits.face[hits.found], hits.found
        sight = directions[found] / np.linalg.norm(directions[found], axis=1, keepdims=True)
        light = np.abs(np.einsum("ni,ni->n", mesh.normals[face], sight))
        light = np.where(shown_mesh.tube[face], 1.0, AMBIENT + (1 - AMBIENT) * light)
        pixels = np.full((width * height, 3), 255.0)
        pixels[found] = shown_mesh.colors[face] * light[:, None]
        small: Pixels = cv2.resize(pixels.reshape(height, width, 3), SIZE, interpolation=cv2.INTER_AREA)
        panels += [np.rint(small).astype(np.uint8), np.full((SIZE[1], GAP, 3), 255, np.uint8)]
    return np.concatenate(panels[:-1], axis=1)


def _view(shown_mesh: DisplayMesh, angle: float) -> PosedCamera:
    """A camera that sees all patches, turned by `angle` degrees around the up axis and a little above the views."""
    side = np.cross(shown_mesh.up, shown_mesh.towards)
    side /= max(float(np.linalg.norm(side)), 1e-12)
    direction = _turned(_turned(shown_mesh.towards, side, -ELEVATION), shown_mesh.up, angle)
    back = -direction
    right = np.cross(back, shown_mesh.up)
    right /= max(float(np.linalg.norm(right)), 1e-12)
    rotation = np.stack([right, np.cross(back, right), back])
    width, height = SIZE[0] * SUPERSAMPLING, SIZE[1] * SUPERSAMPLING
    focal = 0.5 * height / np.tan(np.radians(FIELD_OF_VIEW / 2))
    patches = shown_mesh.vertices[np.unique(shown_mesh.faces[shown_mesh.ids != NO_PATCH])]
    shown = patches[((patches >= shown_mesh.box[0]) & (patches <= shown_mesh.box[1])).all(1)]
    shown = shown if len(shown) else shown_mesh.vertices
    x, y, z = rotation @ (shown - shown_mesh.center).T
    # look at the middle of what is seen, from as near as everything fits
    x0, y0 = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    reach = np.maximum(np.abs(x - x0) * 2 * focal / width, np.abs(y - y0) * 2 * focal / height)
    distance = float((MARGIN * reach - z).max())
    camera = Camera(np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]), (width, height))
    center = shown_mesh.center + rotation.T @ np.array([x0, y0, -distance])
    return PosedCamera(camera, rotation, -rotation @ center)


def _turned(vector: Array, axis: Array, degrees: float) -> Array:
    """A vector rotated around a unit axis (Rodrigues' formula)."""
    a = np.radians(degrees)
    return np.asarray(
        vector * np.cos(a) + np.cross(axis, vector) * np.sin(a) + axis * (axis @ vector) * (1 - np.cos(a))
    )
