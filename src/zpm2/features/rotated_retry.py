"""A second search, smaller and turned, for pairs in which the first one finds few points.

Learned points tolerate turns of about 20 degrees and changes of scale of about 1.5. Cameras turn farther (aerial strips
flown back and forth, a phone in the hand), and a photograph blurred by motion has its corners at a coarser scale than
the sharp one beside it. So where few points agree on one epipolar geometry, both images are searched again at smaller
sizes, the right one turned. The points of all searches are kept: true ones repeat and chance does not, so that a robust
estimator tells them apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import MagsacConfig, RotatedRetryConfig
from zpm2.errors import Failed
from zpm2.features.combined import distinct
from zpm2.features.protocol import PointMatcher
from zpm2.model import Image, PointMatches, thin


@dataclass(frozen=True, eq=False)
class RotatedRetry:
    """`matcher`, and the points of further searches where it finds few."""

    matcher: PointMatcher
    retry_matcher: Callable[[], PointMatcher]  # of the further searches, loaded when it is first needed
    size: int  # px, longer side at which `matcher` works
    config: RotatedRetryConfig

    @property
    def name(self) -> str:
        """See `PointMatcher.name`."""
        return self.matcher.name

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`."""
        found = self.matcher.match(left, right)
        if any(thin(image.width, image.height) for image in (left, right)):
            return found  # a smaller one shows nothing, and a turned one needs a square of its length
        longest = max(left.width, left.height, right.width, right.height)
        config = self.config
        noise = config.noise_px * max(1.0, longest / self.size)
        searches, turns = [found], [np.zeros(len(found), np.int64)]
        for half_turns, enough in ((config.turns, config.min_points), (config.far_turns, config.min_points_far)):
            if len(found) >= config.enough_points or _agreeing(found, noise, config.magsac).sum() >= enough:
                break
            angles = both_ways(half_turns)
            for size in sorted({min(size, longest) for size in config.sizes}):
                for angle, points in zip(angles, self._search(left, right, size, angles), strict=True):
                    searches.append(points)
                    turns.append(np.full(len(points), angle))
            found = PointMatches.join(searches)
        if len(searches) == 1:
            return found
        turned = np.concatenate(turns)[_agreeing(found, noise, config.magsac)]
        best = int(np.argmax(np.bincount(turned % 360))) if len(turned) else 0
        if best:  # the size of the first search, and the turn that it lacked
            view, to_image = _view(right, max(right.width, right.height), best)
            found = PointMatches.join([found, _moved(self.matcher.match(left, view), np.eye(3), to_image)])
        return found[distinct(found, config.merge_px)]

    def _search(self, left: Image, right: Image, size: int, angles: Sequence[int]) -> list[PointMatches]:
        """The points of both images at `size` px, the right one turned by each of `angles`."""
        small, to_left = _view(left, size, 0)
        views = [_view(right, size, angle) for angle in angles]
        found = self.retry_matcher().match_many([(small, view) for view, _ in views])
        return [_moved(points, to_left, to_right) for points, (_, to_right) in zip(found, views, strict=True)]

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`; one search each."""
        return self.matcher.match_many(pairs)


def both_ways(half_turns: Sequence[int]) -> list[int]:
    """Turns to either side, in degrees.

    >>> both_ways((0, 45, 180))
    [0, 45, -45, 180]
    """
    return [angle for turn in half_turns for angle in ((turn, -turn) if turn % 180 else (turn,))]


def _agreeing(points: PointMatches, noise: float, config: MagsacConfig) -> NDArray[np.bool_]:
    """(n,) the points that agree on one epipolar geometry."""
    found = geometry.fundamental_matrix(points.left, points.right, noise, config=config)
    if isinstance(found, Failed):
        return np.zeros(len(points), bool)
    return geometry.epipolar_inliers(found[0], points.left, points.right, noise)


def _view(image: Image, size: int, angle: int) -> tuple[Image, NDArray[np.float64]]:
    """The image at a longer side of `size` px, never enlarged, turned by `angle` degrees; and (3, 3) from its px to px
    of the image. Nothing is cut off."""
    factor = min(1.0, size / max(image.width, image.height))
    width, height = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    rgb: NDArray[np.uint8] = image.rgb
    if factor < 1:
        rgb = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA)
    turned, size_turned = geometry.turn_image(width, height, np.radians(angle))
    if angle:
        rgb = cv2.warpAffine(rgb, geometry.for_opencv(turned)[:2], size_turned, flags=cv2.INTER_LINEAR)
    scale = np.diag([image.width / width, image.height / height, 1.0])
    return Image(np.asarray(rgb, np.uint8)), scale @ np.linalg.inv(turned)


def _moved(points: PointMatches, left: NDArray[np.float64], right: NDArray[np.float64]) -> PointMatches:
    """Points of two views in px of their images."""
    return PointMatches(geometry.project(left, points.left), geometry.project(right, points.right), points.score)
