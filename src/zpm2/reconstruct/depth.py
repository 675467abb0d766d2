"""Depth maps of undistorted views by dense stereo (`stereo.method`), for COLMAP without a GPU for its PatchMatch."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import Config, ReconstructConfig
from zpm2.errors import Failed
from zpm2.files.record import refuse_foreign
from zpm2.files.writing import atomic_write
from zpm2.formats.colmap import open_model, read_poses
from zpm2.geometry import sight_angles
from zpm2.model import PosedCamera
from zpm2.photos.images import read_image
from zpm2.stereo.dense import StereoMatcher, stereo_matcher
from zpm2.stereo.rectify import rectify_views

Array = NDArray[np.float64]
Depth = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SparseView:
    """An undistorted view and the sparse points that it sees."""

    name: str
    camera: PosedCamera
    points: NDArray[np.int64]  # (k,) indices of points


def read_sparse(folder: Path) -> tuple[list[SparseView], Array]:
    """The views of a COLMAP model, by name, and (n, 3) its points. Errors as from `open_model` and `read_poses`."""
    model = open_model(folder)
    row = {key: k for k, key in enumerate(model.points3D)}
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    posed = read_poses(folder)
    seen = {
        image.name: np.array([row[p.point3D_id] for p in image.points2D if p.has_point3D()], np.int64)
        for image in model.images.values()
    }
    return [SparseView(name, camera, np.unique(seen[name])) for name, camera in posed.items()], points


def write_depth_maps(dense: Path, config: Config, tell: Callable[[str, float], None]) -> list[str]:
    """Depth and normal maps of all views of an undistorted workspace of COLMAP, in its format. Existing maps are kept.
    Returns notes on views that got none."""
    views, points = read_sparse(dense / "sparse")
    find = stereo_matcher(config.stereo, config.device)
    notes = []
    for k, view in enumerate(views):
        tell("depth", k / len(views))
        files = [dense / "stereo" / kind / f"{view.name}.geometric.bin" for kind in ("depth_maps", "normal_maps")]
        if all(file.is_file() for file in files):
            for file in files:  # COLMAP trusts the sizes in them
                refuse_foreign(file)
            continue
        depth = _depth(view, views, points, dense / "images", config, find)
        if isinstance(depth, Failed):
            notes.append(f"{view.name}: no depth: {depth}")
            width, height = view.camera.camera.size
            depth = np.full((height, width), np.nan, np.float32)
        _write(files, depth, _normals(depth, view.camera, config.reconstruct))
    tell("depth", 1.0)
    return notes


def choose_neighbors(
    view: SparseView, views: Sequence[SparseView], points: Array, config: ReconstructConfig
) -> list[int]:
    """Indices of the views that share most points with `view`, seen at angles neither too small nor too large."""
    scores = []
    for k, other in enumerate(views):
        if other is view:
            continue
        common = points[np.intersect1d(view.points, other.points)]
        if len(common) < config.min_common_points:
            continue
        angle = float(np.median(sight_angles(common, view.camera.center, other.camera.center)))
        if config.min_angle <= angle <= config.max_angle:
            scores.append((len(common) * min(1.0, angle / config.good_angle), k))
    return [k for _, k in sorted(scores, reverse=True)[: config.neighbors]]


def _depth(
    view: SparseView, views: Sequence[SparseView], points: Array, images: Path, config: Config, find: StereoMatcher
) -> Depth | Failed:
    """(h, w) depth of a view. With three or more neighbours, `min_agreeing` must agree on the depth of a pixel.

    Fusion later compares the depth of different views.
    """
    own = config.reconstruct
    reference = read_image(images / view.name)
    maps, reasons = [], []
    for k in choose_neighbors(view, views, points, own):
        pair = rectify_views(view.camera, views[k].camera, points[view.points], own.range_margin, config.stereo)
        if isinstance(pair, Failed):
            reasons.append(str(pair))
            continue
        left, right = pair.images(reference, read_image(images / views[k].name))
        maps.append(pair.depth(find(left, right, *pair.search)))
    if not maps:
        return Failed(reasons[0] if reasons else "no other view shares enough points from a usable angle")
    return agreed(np.stack(maps), own.depth_agreement, own.min_agreeing if len(maps) > 2 else 1)


def agreed(maps: Depth, tolerance: float, min_count: int) -> Depth:
    """(n, h, w) depths -> (h, w) mean of the largest group of depths that agree; NaN if fewer than `min_count` do.

    A group lies within `tolerance`, a share, of one of its depths.
    """
    best = np.zeros(maps.shape[1:], np.int64)
    result = np.full(maps.shape[1:], np.nan, np.float32)
    for one in maps:
        with np.errstate(invalid="ignore"):
            same = np.abs(maps - one) < tolerance * one
        number = same.sum(0)
        mean = np.where(same, maps, 0).sum(0) / np.maximum(number, 1)
        better = number > best
        best[better], result[better] = number[better], mean[better]
    result[best < min_count] = np.nan
    return result


def _normals(depth: Depth, camera: PosedCamera, config: ReconstructConfig) -> Depth:
    """(h, w, 3) unit normals in the camera's frame, towards the camera; 0 where they are not known."""
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.c_[camera.camera.rays(np.c_[x.ravel(), y.ravel()]), np.ones(depth.size)]
    points = (rays * depth.reshape(-1, 1)).reshape(height, width, 3).astype(np.float32)
    along, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normal = np.cross(down, along)  # towards the camera: y points down
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    normal = np.nan_to_num(normal)
    smooth = cv2.GaussianBlur(normal, (0, 0), config.normal_smoothing)
    size = np.linalg.norm(smooth, axis=2, keepdims=True)
    known = np.isfinite(depth)[..., None] & (size > config.min_normal)
    return np.where(known, smooth / np.maximum(size, 1e-12), 0).astype(np.float32)


def _write(files: Sequence[Path], depth: Depth, normals: Depth) -> None:
    """COLMAP's format: width&height&channels&, then float32, one channel after the other, row by row; 0 is unknown."""
    known = np.where(np.isfinite(depth) & (normals != 0).any(2), depth, 0).astype("<f4")
    height, width = depth.shape
    atomic_write(files[0], f"{width}&{height}&1&".encode() + known.tobytes())
    channels = np.ascontiguousarray(np.moveaxis(normals, 2, 0)).astype("<f4")
    atomic_write(files[1], f"{width}&{height}&3&".encode() + channels.tobytes())
