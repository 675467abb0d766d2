"""Layers of houses, written by code, and what became of them in another layer."""

import json
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.linking.layer import Shapes
from zpm2.linking.similarity import rotation
from zpm2.photos.geolocation import WGS84, between

Array = NDArray[np.float64]
UTM = "EPSG:32633"
PLACE = np.array([500_000.0, 5_000_000.0])  # m, of the first house


def houses(count: int, seed: int = 0, spacing: float = 25.0) -> Array:
    """(n, 4, 2) corners in m of houses of different sizes in a rough grid with gaps."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(1.3 * count)))
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    centers = spacing * grid[rng.permutation(len(grid))[:count]] + rng.uniform(-6, 6, (count, 2))
    corners = rng.uniform(3, 8, (count, 1, 2)) * [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    turned = [each @ rotation(angle).T for each, angle in zip(corners, rng.uniform(-30, 30, count), strict=True)]
    return np.asarray(centers[:, None] + np.stack(turned))


def moved(corners: Array, shift: tuple[float, float], turn: float, noise: float = 0.0, seed: int = 1) -> Array:
    """The same, turned about their middle, shifted, and drawn anew with some noise (m)."""
    center = corners.mean((0, 1))
    drawn = np.random.default_rng(seed).normal(0, noise, corners.shape)
    return np.asarray((corners - center) @ rotation(turn).T + center + shift + drawn)


def shapes(corners: Array) -> Shapes:
    """A layer in metres."""
    return Shapes.of(np.arange(len(corners)), np.asarray(shapely.polygons(corners), object))


def write(path: Path, corners: Array, crs: str = UTM, ids: list[object] | None = None) -> Path:
    """A GeoJSON around `PLACE`; without a member "crs" where it is in longitude and latitude."""
    points = between(UTM, crs, (corners + PLACE).reshape(-1, 2)).reshape(corners.shape)
    rings = np.concatenate([points, points[:, :1]], axis=1).tolist()
    names: list[object] = list(range(len(rings))) if ids is None else ids
    features = [
        {
            "type": "Feature",
            "id": name,
            "properties": {"owner": f"owner {k}"},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for k, (ring, name) in enumerate(zip(rings, names, strict=True))
    ]
    code = {} if crs == WGS84 else {"crs": {"type": "name", "properties": {"name": crs}}}
    path.write_text(json.dumps({"type": "FeatureCollection", **code, "features": features}))
    return path
