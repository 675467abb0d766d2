"""The local point set M2 (paper 3.5.1): what a point matcher finds inside the boxes of each matched pair of polygons.

A crop enlarges a polygon's box, so that even a small polygon gets its own points. The right crop is either the box of
the partner, as in the paper, or the left crop warped by the pair's own map. In the latter case the two crops look
alike, however scale, roll and slant differ between the views.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import PoseConfig
from zpm2.features import PointMatcher
from zpm2.global_match import points_with_data
from zpm2.model import Image, PointMatches, PolygonArrays

Array = NDArray[np.float64]


@dataclass(eq=False)
class ImagePyramid:
    """An image at its own resolution, a half, a quarter, ...; each level is made when it is first used."""

    image: Image
    sharpness: float  # `PoseConfig.crop_sharpness`
    pixels: dict[int, NDArray[np.uint8]] = field(default_factory=dict)

    def crop(self, to_image: Array, side: int) -> Image:
        """(side, side) px of the image: crop px ~ `to_image` (3, 3) lead to image px, centres of both at +0.5."""
        step = np.sqrt(abs(np.linalg.det(geometry.homography_jacobian(to_image, np.full((1, 2), side / 2))[0])))
        level = int(max(0, np.floor(np.log2(max(step, 1e-6)) + self.sharpness)))
        pixels = self._level(level)
        scale = np.diag([pixels.shape[1] / self.image.width, pixels.shape[0] / self.image.height, 1.0])
        matrix = geometry.for_opencv(scale @ to_image)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cut = cv2.warpPerspective(pixels, matrix, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return Image(np.asarray(cut, np.uint8))

    def _level(self, level: int) -> NDArray[np.uint8]:
        if level == 0:
            return self.image.rgb
        if level not in self.pixels:
            size = max(1, self.image.width >> level), max(1, self.image.height >> level)
            self.pixels[level] = np.asarray(cv2.resize(self.image.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        return self.pixels[level]


@dataclass(frozen=True, eq=False)
class Crops:
    """n pairs of square crops."""

    row: NDArray[np.intp]  # (n,) of the matched pairs
    left: Array  # (n, 3, 3) crop px -> image px
    right: Array  # (n, 3, 3)


def boxes(left: PolygonArrays, right: PolygonArrays, config: PoseConfig) -> Crops:
    """The bounding boxes of each matched pair, as the paper takes them."""
    rows = np.flatnonzero(np.minimum(_shorter(left), _shorter(right)) >= config.crop_min_box)
    return Crops(rows, _square(left, config)[rows], _square(right, config)[rows])


def rectified(
    left: PolygonArrays, right: PolygonArrays, maps: Array, confidence: Array, zoom: float, config: PoseConfig
) -> Crops:
    """Boxes of left polygons, and the same warped into the right image by `maps` (n, 3, 3; right ~ map @ left).

    The most confident pairs come first, up to `max_crops`. A box is left out if the whole image, searched at `zoom` px
    per image px, showed it as large, or if an earlier crop shows it too. So are pairs with a map that no view of a
    surface can have (mirrored, or torn by its horizon).
    """
    squares = _square(left, config)
    there = maps @ squares
    gains = 1 / squares[:, 0, 0] > config.crop_min_zoom * zoom
    large = np.minimum(_shorter(left), _shorter(right)) >= config.crop_min_box
    usable = gains & large & _shows_surface(there, config)
    corners = left.bounds
    chosen: list[int] = []
    for k in np.argsort(-confidence, kind="stable"):
        if (
            usable[k]
            and len(chosen) < config.max_crops
            and not (_iou(corners[k], corners[chosen]) > config.crop_max_iou).any()
        ):
            chosen.append(int(k))
    rows = np.sort(np.array(chosen, np.intp))
    return Crops(rows, squares[rows], there[rows])


def match(crops: Crops, images: tuple[Image, Image], matcher: PointMatcher, config: PoseConfig) -> PointMatches:
    """Homologous points of all crops in px of the original images."""
    left, right = (ImagePyramid(image, config.crop_sharpness) for image in images)
    side = config.crop_size
    pairs = [(left.crop(a, side), right.crop(b, side)) for a, b in zip(crops.left, crops.right, strict=True)]
    found = matcher.match_many(pairs)
    parts = []
    for a, b, points in zip(crops.left, crops.right, found, strict=True):
        moved = PointMatches(geometry.project(a, points.left), geometry.project(b, points.right), points.score)
        inside = _within(moved.left, images[0]) & _within(moved.right, images[1])
        parts.append(moved[inside])
    return points_with_data(PointMatches.join(parts), images)


def _square(polygons: PolygonArrays, config: PoseConfig) -> Array:
    """(n, 3, 3) from the square of a crop to the square around each box and its margin."""
    side = config.crop_size
    low, high = polygons.bounds[:, :2], polygons.bounds[:, 2:]
    size = np.maximum((high - low).max(1) * (1 + 2 * config.crop_margin), side / config.crop_max_zoom)
    matrices = np.zeros((len(size), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = size / side
    matrices[:, :2, 2] = (low + high) / 2 - size[:, None] / 2
    matrices[:, 2, 2] = 1.0
    return matrices


def _shorter(polygons: PolygonArrays) -> Array:
    return np.asarray((polygons.bounds[:, 2:] - polygons.bounds[:, :2]).min(1))


def _shows_surface(matrices: Array, config: PoseConfig) -> NDArray[np.bool_]:
    """(n,) whether the corners of a crop keep their orientation, and none is stretched far more than another."""
    side = config.crop_size
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float64)
    areas = np.array([np.linalg.det(geometry.homography_jacobian(m, corners)) for m in matrices]).reshape(-1, 4)
    weights = np.einsum("nj,cj->nc", matrices[:, 2], geometry.homogeneous(corners)) * np.sign(matrices[:, 2, 2:])
    even = areas.max(1) < config.crop_max_stretch * areas.min(1)
    return np.asarray((weights > 0).all(1) & (areas > 0).all(1) & even)


def _iou(box: Array, others: Array) -> Array:
    """(n,) IoU of a box (4,) with others (n, 4): x0, y0, x1, y1."""
    low, high = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
    both = np.prod(np.maximum(high - low, 0), axis=1)
    areas = [np.prod(b[..., 2:] - b[..., :2], axis=-1) for b in (box, others)]
    return np.asarray(both / np.maximum(areas[0] + areas[1] - both, 1e-300))


def _within(points: Array, image: Image) -> NDArray[np.bool_]:
    return np.asarray(((points > 0) & (points < [image.width, image.height])).all(1))
