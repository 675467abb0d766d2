"""Whether both photographs show the same where the points put a region: what does is at its place, and did not move."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.carry.places import Places, places
from zpm2.config import CarryConfig, Config
from zpm2.global_match import Candidates, InitialGeometry
from zpm2.local_match.texture import TexturePatches, correlation
from zpm2.model import Image

Array = NDArray[np.float64]
FLAT = 1e-12  # determinant of a map that brings a region onto a line or a point


@dataclass(frozen=True, eq=False)
class Resemblance:
    """How alike both photographs are in places, the left one moved as the points say."""

    values: Array  # (n,) 0..1, 1 is as well as around the points of the pair; NaN without texture or place
    power: float  # 0..1, how much they say

    def trust(self, found: Places, config: CarryConfig) -> Array:
        """(n,) 0..1, the trust in each place, from that of the points: raised where the photographs resemble each
        other, lowered where they do not."""
        told = self.power * np.nan_to_num(2 * self.values - 1)  # -1..1
        raised = found.trust + (1 - found.trust) * told
        return np.where(told > 0, raised, found.trust * (1 + config.doubt * told))

    def exact(self, found: Places, initial: InitialGeometry, config: CarryConfig) -> Array:
        """(n,) 0..1, the IoU that is expected of a region's own outline at its place: as far as one plane explains the
        points, and the photographs resemble each other there, or, where that says nothing, the points agree."""
        alike = np.where(self.values >= config.shows, self.values, 0.0)
        return np.asarray(one_plane(initial) * (self.power * alike + (1 - self.power) * found.trust))


def resemblance(images: tuple[Image, Image], found: Places, initial: InitialGeometry, config: Config) -> Resemblance:
    """Compares both photographs in each place with what they have around the points of the pair.

    So other light, an oblique view or another sensor is no doubt in a region. Photographs that correlate little even
    around the points, by day and by night for instance, say little.
    """
    usual = correlations(images, _around_points(initial, config), config)
    best = float(np.median(usual[~np.isnan(usual)])) if (~np.isnan(usual)).any() else 1.0
    values = np.minimum(correlations(images, found, config) / max(best, config.carry.least_usual), 1.0)
    return Resemblance(values, min(best / config.carry.clear, 1.0))


def correlations(images: tuple[Image, Image], found: Places, config: Config) -> Array:
    """(n,) 0..1, the correlation of both photographs inside each place; NaN without texture or place. What correlates
    negatively has 0."""
    settings, n = config.local_match, len(found.shapes)
    known = np.abs(np.linalg.det(found.maps)) > FLAT
    back: Array = np.linalg.inv(np.where(known[:, None, None], found.maps, np.eye(3))).astype(np.float64)
    to_image = back, np.tile(np.eye(3), (n, 1, 1))
    left, right = (
        TexturePatches(image, found.shapes, maps, settings.patch, settings.max_halvings)
        for image, maps in zip(images, to_image, strict=True)
    )
    rows = np.arange(n)
    value = correlation((left, right), Candidates(rows, rows), config.carry.min_contrast)
    return np.where(known & (value != 0), np.maximum(value, 0.0), np.nan)


def one_plane(initial: InitialGeometry) -> float:
    """0..1, the share of the points of one geometry that one plane explains: how exact outlines moved by it are."""
    return float(initial.planar[initial.consistent].mean()) if initial.consistent.any() else 0.0


def _around_points(initial: InitialGeometry, config: Config) -> Places:
    """Where the points put squares around some of them, with one px for each cell of a patch."""
    points = initial.forward()[0].left
    rows = np.linspace(0, len(points) - 1, min(len(points), config.carry.samples)).astype(np.intp)
    half = config.local_match.patch / 2
    squares = shapely.box(*(points[rows] - half).T, *(points[rows] + half).T)
    return places(squares, initial, config.carry, config.local_match)
