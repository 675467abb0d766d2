"""Regions drawn on surfaces that are known exactly, as several cameras see them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.cloud import MatchedPair, PolygonCloud, PosedPhotograph, SurfaceMesh, build, open_caster
from zpm2.config import CloudConfig, preset
from zpm2.errors import Failed
from zpm2.model import Camera, ImagePolygons, PointMatches, Polygon, PolygonMatch, PosedCamera
from zpm2.result import MatchResult

Array = NDArray[np.float64]
CAMERA = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (640, 480))


def looking_down(x: float, y: float, height: float, offset: Sequence[float] = (0, 0, 0)) -> PosedCamera:
    """A camera over (x, y) that looks at the origin."""
    center = np.array([x, y, height])
    back = -center / np.linalg.norm(center)
    right = np.cross(back, [0, 1.0, 0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(back, right), back])
    return PosedCamera(CAMERA, rotation, -rotation @ (center + offset))


def squares(offset: Sequence[float] = (0, 0, 0), height: float = 0.0) -> list[Array]:
    """Nine outlines (n, 3) in a plane, dense, so that they are what a camera sees of them."""
    found = []
    for k in range(9):
        low = np.array([k % 3, k // 3]) * 0.4 - 0.55
        corners = low + 0.3 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        ring = np.concatenate(
            [
                a + (b - a) * np.linspace(0, 1, 8, endpoint=False)[:, None]
                for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
            ]
        )
        found.append(np.c_[ring, np.full(len(ring), height)] + offset)
    return found


def matched(
    outlines: Sequence[Array], cameras: tuple[PosedCamera, PosedCamera], partner: Sequence[int] | None = None
) -> MatchResult:
    """The outlines as two cameras see them; left polygon k is matched with right polygon partner[k] (else k)."""
    sides = []
    for camera in cameras:
        polygons = [Polygon(k, camera.project(outline)) for k, outline in enumerate(outlines)]
        sides.append(ImagePolygons(640, 480, polygons))
    partner = range(len(outlines)) if partner is None else partner
    matches = [PolygonMatch(k, p, 0.9 - 0.01 * k, 1.0, 9, "global") for k, p in enumerate(partner)]
    nothing, why = PointMatches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)), Failed("not asked for")
    return MatchResult(*sides, matches, nothing, why, why, {}, {})


def views_of(cameras: Sequence[PosedCamera], folder: Path) -> list[PosedPhotograph]:
    """The cameras with grey photographs."""
    found = []
    for k, camera in enumerate(cameras):
        path = folder / f"{k}.png"
        PIL.Image.new("RGB", camera.camera.size, (90, 120, 40 + k)).save(path)
        found.append(PosedPhotograph(path.name, path, camera))
    return found


def cloud_of(
    surface: SurfaceMesh,
    outlines: Sequence[Array],
    cameras: Sequence[PosedCamera],
    folder: Path,
    wrong: Sequence[int] | None = None,
    config: CloudConfig | None = None,
) -> PolygonCloud:
    """The cloud of outlines matched between each camera and the next; `wrong`: partners in the first pair."""
    pairs = [
        MatchedPair(k, k + 1, matched(outlines, (cameras[k], cameras[k + 1]), wrong if k == 0 else None))
        for k in range(len(cameras) - 1)
    ]
    return build(views_of(cameras, folder), pairs, surface, open_caster(surface), config or preset("default").cloud)
