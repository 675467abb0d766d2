"""What a point matcher is: images in, homologous points out. A sparse one consists of a detector and a matcher."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.model import Image, PointMatches
from zpm2.photos.kept import NOTHING_KEPT, Form, KeptPhotos
from zpm2.photos.shelf import Arrays


class PointMatcher(Protocol):
    """Finds homologous points, with a detector or without."""

    @property
    def name(self) -> str:
        """What it is called in `PointsConfig.methods`."""
        ...

    def match(self, left: Image, right: Image) -> PointMatches:
        """Homologous points in px of the original images, pixel centres at +0.5.

        The same images give the same bytes. Images in which nothing is found give `PointMatches.empty()`.
        """
        ...

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """The same for many small pairs (crops), which networks process in batches."""
        ...


@dataclass(frozen=True, eq=False)
class Features:
    """Described points of one image."""

    points: NDArray[np.float64]  # (n, 2) px of the original image, pixel centres at +0.5
    descriptors: NDArray[np.float32]  # (n, d)
    scores: NDArray[np.float64]  # (n,) the detector's own, larger is better; no common scale
    size: tuple[int, int]  # (width, height) of the original image, px

    def __len__(self) -> int:
        return len(self.points)


def _written(features: Features) -> Arrays:
    points, descriptors, scores = features.points, features.descriptors, features.scores
    return {"points": points, "descriptors": descriptors, "scores": scores, "size": np.array(features.size)}


def _read(arrays: Arrays) -> Features:
    points, scores = np.asarray(arrays["points"], np.float64), np.asarray(arrays["scores"], np.float64)
    width, height = (int(side) for side in arrays["size"])
    return Features(points, np.asarray(arrays["descriptors"], np.float32), scores, (width, height))


class Detector(Protocol):
    """First half of a sparse matcher: finds and describes points of one image."""

    def detect(self, images: Sequence[Image]) -> list[Features]:
        """The points of each image."""
        ...


class FeatureMatcher(Protocol):
    """Second half of a sparse matcher: decides which point of one image is which point of the other."""

    def pair(self, left: Features, right: Features) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """(k, 2) rows of `left` and `right` that belong together, none used twice, and their (k,) scores 0..1.

        Called only with at least one point on either side.
        """
        ...


@dataclass(frozen=True, eq=False)
class SparseMatcher:
    """A detector and a matcher of what it finds."""

    name: str
    detector: Detector
    matcher: FeatureMatcher

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`."""
        return self.match_kept(left, right, NOTHING_KEPT)

    def match_kept(self, left: Image, right: Image, kept: KeptPhotos) -> PointMatches:
        """The same, with the features of photographs that are `kept`."""
        return self._pair(self._features(left, kept), self._features(right, kept))

    def _features(self, image: Image, kept: KeptPhotos) -> Features:
        return kept.found(image, (self.name, id(self)), lambda: self.detector.detect([image])[0], Form(_written, _read))

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`."""
        images = {id(image): image for pair in pairs for image in pair}  # one that is in many pairs is detected once
        found = dict(zip(images, self.detector.detect(list(images.values())), strict=True))
        return [self._pair(found[id(left)], found[id(right)]) for left, right in pairs]

    def _pair(self, a: Features, b: Features) -> PointMatches:
        if not len(a) or not len(b):
            return PointMatches.empty()
        rows, scores = self.matcher.pair(a, b)
        return PointMatches(a.points[rows[:, 0]], b.points[rows[:, 1]], scores)
