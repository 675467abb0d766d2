"""Regions without any weights: those of a `partition_tree` whose colour stands out most from their surroundings.

It takes prompts: a point asks for the regions around it, a box for those that fit it best.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.model import Image, Mask
from zpm2.segment import automatic
from zpm2.segment.mask_view import MaskView
from zpm2.segment.partition_tree import PartitionTree, partition_tree
from zpm2.segment.predictions import CORNER, MASK_SIDE, MaskPredictions, MaskThresholds, Prompts

FINE = 2  # px of the tree's image per px of a decoded mask, along each side
PER_PROMPT = 3  # masks, as SAM predicts them: a whole, a part and a subpart
LOGIT = 8.0  # of a pixel that is wholly inside
WARNING = (
    "regions are by the classical segmenter, which knows colours and no objects: expect fewer and worse matches than "
    "with SAM, above all on texture and across shadows"
)


class ClassicalSegmenter:
    """A `PromptedSegmenter` without weights, on the CPU. Its score is the contrast of a region (`PartitionTree`).

    `smoothing` is that of the photograph before its gradient is taken, px at 512 px along the longer side, `noise` the
    gradient that counts as none, CIELAB per px. `progress` receives the share of an image that is done, 0..1.
    """

    name = "classical"

    def __init__(
        self,
        config: SegmentConfig,
        progress: Callable[[float], None] = lambda share: None,
        *,
        smoothing: float = 1.0,
        noise: float = 1.0,
    ) -> None:
        self.config, self.progress = config, progress
        self.smoothing, self.noise = smoothing, noise
        self.notes = [WARNING]

    def view(self, image: Image) -> "TreeView":
        """The photograph, as a tree of regions."""
        return TreeView(image, self.smoothing, self.noise)

    def segment(self, image: Image) -> list[Mask]:
        """The regions, highest contrast first."""
        return automatic.regions(self.view(image), self.config, self.progress)


class TreeView(MaskView):
    """One photograph as a tree of regions. Implements `PromptedView`."""

    batch = 64

    def __init__(self, image: Image, smoothing: float, noise: float) -> None:
        super().__init__(image, FINE * MASK_SIDE)
        scale = FINE * self.mask_scale
        height, width = self.size
        reduced = cv2.warpAffine(
            _averaged(image.rgb, scale),
            np.array([[1.0, 0, 0], [0, 1, 0]]),
            (FINE * width, FINE * height),
            borderMode=cv2.BORDER_REPLICATE,
        )
        self._known: dict[int, NDArray[np.float16]] = {}  # at most 130 kB each, some hundred of them
        self.tree: PartitionTree = partition_tree(np.asarray(reduced, np.uint8), smoothing, noise)

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The regions of each prompt whose contrast reaches the threshold; a tree's regions have no stability."""
        prompt, nodes = [], []
        for k, points in enumerate(prompts.points * (FINE * self.mask_scale)):
            chosen = self._nodes(points, prompts.labels)
            nodes.append(chosen[self.tree.contrast[chosen] >= thresholds.predicted_iou])
            prompt.append(np.full(len(nodes[-1]), k, np.int64))
        every = np.concatenate([np.zeros(0, np.int64), *nodes])
        if len(every) == 0:
            return MaskPredictions.none(self.size)
        score = self.tree.contrast[every].astype(np.float32)
        logits = np.stack([self._logits(int(node)) for node in every])
        return MaskPredictions(np.concatenate(prompt), score, np.ones(len(every), np.float32), logits)

    def _nodes(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.int64]:
        """The regions that a prompt (P, 2), px of the tree's image, asks for, best first."""
        tree = self.tree
        rows, columns = tree.rank.shape
        column, row = np.clip(points[0].astype(np.int64), 0, [columns - 1, rows - 1])
        around = tree.ancestors(int(tree.leaf[tree.rank[row, column]]))[:-1]  # without the whole image
        rating = tree.contrast[around]
        if len(corners := points[labels >= CORNER]):
            low, high = corners.min(0), corners.max(0)
            box = tree.box[around]
            shared = np.maximum(np.minimum(high, box[:, 2:]) - np.maximum(low, box[:, :2]), 0).prod(1)
            both = (high - low).prod() + (box[:, 2:] - box[:, :2]).prod(1) - shared
            rating = shared / np.maximum(both, 1e-9)
        return around[np.argsort(-rating, kind="stable")[:PER_PROMPT]]

    def _logits(self, node: int) -> NDArray[np.float16]:
        """(height, width) the share of each pixel that lies inside, from -LOGIT to LOGIT."""
        if node not in self._known:
            box = self.tree.box[node]
            (x0, y0), (x1, y1) = box[:2] // FINE, -(-box[2:] // FINE)
            part = np.s_[FINE * y0 : FINE * y1, FINE * x0 : FINE * x1]
            inside = self.tree.bits(node, part).reshape(y1 - y0, FINE, x1 - x0, FINE).mean((1, 3))
            logits = np.full(self.size, -LOGIT, np.float16)
            logits[y0:y1, x0:x1] = (2 * inside - 1) * LOGIT
            self._known[node] = logits
        return self._known[node]


def _averaged(rgb: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    """The image at `scale`."""
    size = max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR), np.uint8)
