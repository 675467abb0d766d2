"""A small rendered pair with regions that are known to correspond, for tests that need a whole run but no network."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.evaluate.rendered import RenderedScene

CELL = 60  # px, side of the squares that regions are cut at
STEP = 4.0  # px of disparity, likewise
LEAST = 200  # px^2, smaller regions are background


class Outcome(NamedTuple):
    """What a run of the command line left behind."""

    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


@dataclass(frozen=True, eq=False)
class Pair:
    """The pair as files. Region k of `left_regions` and region k of `right_regions` are one surface."""

    scene: RenderedScene
    left: Path
    right: Path
    left_regions: Path
    right_regions: Path

    @property
    def regions(self) -> list[str]:
        """Command line options: the known regions, and points that need no weights."""
        files = ["--left-regions", str(self.left_regions), "--right-regions", str(self.right_regions)]
        return ["--segmenter", "precomputed", *files, "--points", "sift", "--device", "cpu"]


def save_pair(scene: RenderedScene, folder: Path) -> Pair:
    """Writes photographs and label images."""
    labels = regions_of(scene.disparity)
    pair = Pair(scene, *(folder / f"{name}.png" for name in ("left", "right", "left_labels", "right_labels")))
    PIL.Image.fromarray(scene.left).save(pair.left)
    PIL.Image.fromarray(scene.right).save(pair.right)
    PIL.Image.fromarray(labels).save(pair.left_regions)
    PIL.Image.fromarray(_carried(labels, scene)).save(pair.right_regions)
    return pair


def regions_of(disparity: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    """(h, w) labels from 1 on: pieces of like depth, cut at a grid; 0 where pieces are small."""
    rows, columns = np.indices(disparity.shape)
    layer = np.floor(disparity / STEP).astype(np.int64)
    cell = (layer * 1000 + rows // CELL) * 1000 + columns // CELL
    labels = np.zeros(disparity.shape, np.uint16)
    for value in np.unique(cell):
        count, parts, stats, _ = cv2.connectedComponentsWithStats((cell == value).astype(np.uint8), connectivity=4)
        for k in range(1, count):
            if stats[k, cv2.CC_STAT_AREA] >= LEAST:
                labels[parts == k] = labels.max() + 1
    return labels


def fewer(matches: Path, folder: Path, count: int) -> Path:
    """A copy of a saved result with every n-th match only, `count` of them: what is made of each takes its time."""
    document = json.loads((matches / "matches.json").read_text())
    found = document["matches"]
    document["matches"] = [found[k * len(found) // count] for k in range(count)]
    (folder / "matches.json").write_text(json.dumps(document))
    return folder


def photograph(seed: int, width: int = 400, height: int = 240) -> NDArray[np.uint8]:
    """(height, width, 3) octaves of coloured noise, a picture of nothing that any other seed shows."""
    random = np.random.default_rng(seed)
    out = np.zeros((height, width, 3), np.float32)
    for octave in range(2, 8):
        grid = random.standard_normal((2**octave, 2**octave, 3)).astype(np.float32)
        out += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) / octave
    return np.asarray(np.clip(out / out.std() * 50 + 128, 0, 255), np.uint8)


def _carried(labels: NDArray[np.uint16], scene: RenderedScene) -> NDArray[np.uint16]:
    """The left image's labels as the right camera sees them; 0 where the left one does not."""
    rows, columns = np.indices(labels.shape)
    seen_at = np.floor(columns + 0.5 + scene.disparity_right).astype(np.int64).clip(0, labels.shape[1] - 1)
    return np.where(scene.occluded_right, 0, labels[rows, seen_at]).astype(np.uint16)
