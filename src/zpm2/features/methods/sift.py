"""SIFT (Lowe, IJCV 2004): OpenCV's detector and a mutual nearest neighbour search with the ratio test. No weights."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import PointsConfig
from zpm2.features.protocol import Features, PointMatcher, SparseMatcher
from zpm2.features.registry import point_matcher
from zpm2.model import Image
from zpm2.plugins import ModelInfo
from zpm2.weights import Progress

ROWS_AT_ONCE = 1024  # of the distance matrix, to bound the memory


@point_matcher(
    "sift",
    ModelInfo(
        task="points with a detector, without weights",
        code_licence="Apache-2.0",
        training_data="none",
        bytes_per_pixel=240.0,
        full_size=True,
        device="cpu",
    ),
)
def sift(config: PointsConfig, device: str, progress: Progress | None) -> PointMatcher:
    """SIFT, always on the CPU."""
    return SparseMatcher(
        "sift", SiftDetector(config.max_keypoints, config.sift_contrast), RatioMatcher(config.sift_ratio)
    )


@dataclass(frozen=True)
class SiftDetector:
    """The `max_keypoints` strongest SIFT points, at full resolution, with RootSIFT descriptors.

    RootSIFT (Arandjelovic and Zisserman, CVPR 2012) is the square root of the L1-normalised descriptor, so that the
    Euclidean distance becomes the Hellinger distance. `enable_precise_upscale` removes the shift of a quarter
    pixel that OpenCV's doubling of the image brings.
    """

    max_keypoints: int
    contrast: float = 0.04  # OpenCV's `contrastThreshold`

    def detect(self, images: Sequence[Image]) -> list[Features]:
        """See `Detector.detect`."""
        return [self._detect(image) for image in images]

    def _detect(self, image: Image) -> Features:
        sift = cv2.SIFT.create(
            nfeatures=self.max_keypoints, contrastThreshold=self.contrast, enable_precise_upscale=True
        )
        found, raw = sift.detectAndCompute(np.rint(image.gray).astype(np.uint8), None)
        if raw is None:
            return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32), np.zeros(0), (image.width, image.height))
        response = np.array([p.response for p in found])
        best = np.argsort(-response, kind="stable")[: self.max_keypoints]
        points = np.array([p.pt for p in found], np.float64)[best] + 0.5
        descriptors = np.sqrt(raw[best] / np.maximum(raw[best].sum(1, keepdims=True), 1e-12)).astype(np.float32)
        return Features(points, descriptors, response[best], (image.width, image.height))


@dataclass(frozen=True)
class RatioMatcher:
    """Pairs that are each other's nearest neighbour and pass the ratio test both ways; descriptors of unit length.

    The score is 1 - ratio, of the worse direction: 1 for identical descriptors.
    """

    ratio: float = 0.8  # largest, of the distances to the nearest and the second nearest

    def pair(self, left: Features, right: Features) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """See `FeatureMatcher.pair`."""
        to_right, ratio_left = _nearest(left.descriptors, right.descriptors)
        to_left, ratio_right = _nearest(right.descriptors, left.descriptors)
        rows = np.flatnonzero(to_left[to_right] == np.arange(len(left)))
        worse = np.maximum(ratio_left[rows], ratio_right[to_right[rows]])
        good = worse <= self.ratio
        rows = rows[good]
        return np.c_[rows, to_right[rows]], 1.0 - worse[good]


def _nearest(query: NDArray[np.float32], base: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """(n,) row of `base` nearest to each row of `query`, and the ratio of its distance to that of the second nearest.

    The ratio is 1 where there is no second one, since nothing then tells a match from chance.
    """
    nearest = np.zeros(len(query), np.intp)
    ratio = np.ones(len(query))
    base = base.copy()  # an array times itself is another routine of BLAS, which rounds differently
    for start in range(0, len(query), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        squared = np.maximum(2.0 - 2.0 * (query[rows] @ base.T), 0.0)
        nearest[rows] = squared.argmin(1)
        if len(base) > 1:
            two = np.sqrt(np.partition(squared, 1, axis=1)[:, :2].astype(np.float64))
            ratio[rows] = np.where(two[:, 1] > 0, two[:, 0] / np.maximum(two[:, 1], 1e-12), 1.0)
    return nearest, ratio
