"""Homologous points of real pairs, found once and kept: what the benchmarks of points alone share."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from zpm2 import config
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import EvalPair
from zpm2.global_match.pair_points import PointFinder
from zpm2.model import PointMatches
from zpm2.photos.images import read_image
from zpm2.runtime import StageTimer

Size = tuple[int, int]  # width, height, px


class KnownPoints:
    """The points that preset `default` finds in a pair, further looks included, kept as .npz in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.finder: PointFinder | None = None
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, name: str, left: Path, right: Path) -> tuple[PointMatches, Size, Size]:
        """The points of a pair and the sizes of its images."""
        file = self.folder / (name.replace("/", "__") + ".npz")
        if not file.exists():
            self.finder = self.finder or PointFinder(config.preset("default"), "cpu")
            images = read_image(left, "left image"), read_image(right, "right image")
            found = self.finder(images, StageTimer(lambda stage, share: None)).initial.points
            size = [side for image in images for side in (image.width, image.height)]
            np.savez(file, left=found.left, right=found.right, score=found.score, size=size)
        kept = np.load(file)
        wide, high, wide2, high2 = (int(side) for side in kept["size"])
        return PointMatches(kept["left"], kept["right"], kept["score"]), (wide, high), (wide2, high2)


def pairs_of(roots: Sequence[Path]) -> Iterator[EvalPair]:
    """The pairs of several folders with a pairs.json, each couple of photographs once."""
    seen = set()
    for root in roots:
        for pair in open_dataset("pairs", root, None).pairs():
            photographs = pair.left.resolve(), pair.right.resolve()
            if photographs not in seen:
                seen.add(photographs)
                yield pair
