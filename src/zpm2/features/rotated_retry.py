"""A second look, smaller and turned, for pairs in which the first one finds little.

Learned points stand turns of some 20 degrees and scales of some 1.5. Cameras turn farther (aerial strips that are flown
back and forth, a hand that holds a phone), and a photograph blurred by motion has its corners at a coarser scale than
the sharp one beside it. So where few points agree on one epipolar geometry, both images are shown again at smaller
sizes, the right one turned. Points of all looks are kept: what is true in one look is true in the next, what is chance
is not, and a robust estimator tells them apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.errors import Failed
from zpm2.features.combined import distinct
from zpm2.features.protocol import PointMatcher
from zpm2.model import Image, PointMatches, thin

ENOUGH = (200, 100)  # points that agree, with which no first, no second further round is made
MANY = 1000  # points, of which enough agree
ROUNDS = ((0, 45, -45), (90, -90, 135, -135, 180))  # degrees by which the right image is turned
SIZES = (640, 1000)  # px, longer side
NOISE_PX = 3.0  # px of the image, of points that agree; where it was reduced, of the reduced one
SAME_PX = 2.0  # px, in both images: points of two looks that are closer are one


@dataclass(frozen=True, eq=False)
class RotatedRetry:
    """`matcher`, and what `again` finds in further looks where that finds little."""

    matcher: PointMatcher
    again: Callable[[], PointMatcher]  # loaded when it is first needed
    size: int  # px, longer side at which `matcher` works

    @property
    def name(self) -> str:
        return self.matcher.name

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`."""
        found = self.matcher.match(left, right)
        if any(thin(image.width, image.height) for image in (left, right)):
            return found  # made smaller there is nothing to see, and turned it needs a square of its length
        longest = max(left.width, left.height, right.width, right.height)
        noise = NOISE_PX * max(1.0, longest / self.size)
        looks, turns = [found], [np.zeros(len(found), np.int64)]
        for angles, enough in zip(ROUNDS, ENOUGH, strict=True):
            if len(found) >= MANY or _agreeing(found, noise).sum() >= enough:
                break
            for size in sorted({min(size, longest) for size in SIZES}):
                for angle, points in zip(angles, self._look(left, right, size, angles), strict=True):
                    looks.append(points)
                    turns.append(np.full(len(points), angle))
            found = PointMatches.join(looks)
        if len(looks) == 1:
            return found
        turned = np.concatenate(turns)[_agreeing(found, noise)]
        best = int(np.argmax(np.bincount(turned % 360))) if len(turned) else 0
        if best:  # the size of the first look, and the turn that it lacked
            view, to_image = _view(right, max(right.width, right.height), best)
            found = PointMatches.join([found, _moved(self.matcher.match(left, view), np.eye(3), to_image)])
        return found[distinct(found, SAME_PX)]

    def _look(self, left: Image, right: Image, size: int, angles: Sequence[int]) -> list[PointMatches]:
        """The points of both images at `size` px, the right one turned by each of `angles`."""
        small, to_left = _view(left, size, 0)
        views = [_view(right, size, angle) for angle in angles]
        found = self.again().match_many([(small, view) for view, _ in views])
        return [_moved(points, to_left, to_right) for points, (_, to_right) in zip(found, views, strict=True)]

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`; one look each."""
        return self.matcher.match_many(pairs)


def _agreeing(points: PointMatches, noise: float) -> NDArray[np.bool_]:
    """(n,) the points that agree on one epipolar geometry."""
    found = geometry.fundamental_matrix(points.left, points.right, noise)
    if isinstance(found, Failed):
        return np.zeros(len(points), bool)
    return geometry.epipolar_inliers(found[0], points.left, points.right, noise)


def _view(image: Image, size: int, angle: int) -> tuple[Image, NDArray[np.float64]]:
    """The image at a longer side of `size` px, never enlarged, turned by `angle` degrees; and (3, 3) from its px to px
    of the image. Nothing is cut off."""
    factor = min(1.0, size / max(image.width, image.height))
    width, height = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    rgb: NDArray[Any] = image.rgb
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
