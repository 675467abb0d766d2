"""Features of photographs that left the memory."""

import numpy as np

from zpm2.features.protocol import Features, SparseMatcher
from zpm2.model import Image
from zpm2.photos.kept import KeptPhotos
from zpm2.photos.shelf import Shelf


class Corners:
    """A detector that remembers what it saw, and a matcher of rows."""

    def __init__(self) -> None:
        self.seen: list[Image] = []

    def detect(self, images):
        self.seen += images
        rng = np.random.default_rng(len(self.seen))
        return [Features(rng.random((3, 2)), rng.random((3, 4), np.float32), rng.random(3), (5, 4)) for _ in images]

    def pair(self, left, right):
        assert (left.size, right.size) == ((5, 4), (5, 4))
        return np.c_[:3, :3], left.descriptors[:, 0].astype(float)


def test_each_photograph_is_looked_at_once(tmp_path):
    corners, kept = Corners(), KeptPhotos(2, Shelf(tmp_path, 1e6))
    matcher = SparseMatcher("corners", corners, corners)

    def match(i: int, j: int):
        images = [kept.same(Image(np.full((4, 5, 3), value, np.uint8))) for value in (i, j)]
        return matcher.match_kept(*images, kept)

    first = match(0, 1)
    match(2, 3)
    again = match(0, 1)
    assert len(corners.seen) == 4
    for one, other in zip((first.left, first.right, first.score), (again.left, again.right, again.score), strict=True):
        assert one.tobytes() == other.tobytes()
