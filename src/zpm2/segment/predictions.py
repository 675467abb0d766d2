"""Prompts and the masks that a promptable segmenter predicts for them, at the resolution at which it decodes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MASK_SIDE = 256  # px, longer side of a decoded mask

INSIDE, CORNER, OTHER_CORNER = 1, 2, 3  # labels of a prompt's points


@dataclass(frozen=True, eq=False)
class Prompts:
    """n prompts of one form: each has the same number of points, with the same labels."""

    points: NDArray[np.float64]  # (n, P, 2) image px
    labels: NDArray[np.int64]  # (P,) INSIDE for a point of the region, CORNER and OTHER_CORNER for its box

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: NDArray[np.intp] | slice) -> "Prompts":
        return Prompts(self.points[rows], self.labels)

    @staticmethod
    def at(points: NDArray[np.float64]) -> "Prompts":
        """One point (n, 2), image px, per prompt."""
        return Prompts(points[:, None], np.array([INSIDE]))


@dataclass(frozen=True)
class MaskThresholds:
    """The least quality of a mask. Masks below it are not decoded, or dropped."""

    predicted_iou: float  # 0..1, the model's own estimate of a mask's quality
    stability: float  # 0..1, IoU of the mask cut at +offset and at -offset


@dataclass(frozen=True, eq=False)
class MaskPredictions:
    """Masks of one view, several per prompt or none."""

    prompt: NDArray[np.int64]  # (n,) row of the prompt
    score: NDArray[np.float32]  # (n,) predicted IoU
    stability: NDArray[np.float32]  # (n,)
    logits: NDArray[np.float16]  # (n, h, w) of the view's `size`, inside where > 0

    def __len__(self) -> int:
        return len(self.prompt)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "MaskPredictions":
        return MaskPredictions(self.prompt[rows], self.score[rows], self.stability[rows], self.logits[rows])

    def passing(self, thresholds: MaskThresholds) -> NDArray[np.bool_]:
        """(n,) which of them reach the thresholds."""
        return np.asarray((self.score >= thresholds.predicted_iou) & (self.stability >= thresholds.stability))

    @property
    def bits(self) -> NDArray[np.bool_]:
        """(n, h, w) the masks."""
        return np.asarray(self.logits > 0)

    @staticmethod
    def none(size: tuple[int, int]) -> "MaskPredictions":
        """No mask, of a view of `size` (height, width)."""
        nothing = np.zeros(0, np.float32)
        return MaskPredictions(np.zeros(0, np.int64), nothing, nothing, np.zeros((0, *size), np.float16))

    @staticmethod
    def join(parts: "list[MaskPredictions]") -> "MaskPredictions":
        """The masks of one or more parts, one after the other. Each part keeps its own rows of prompts."""
        return MaskPredictions(
            np.concatenate([p.prompt for p in parts]),
            np.concatenate([p.score for p in parts]),
            np.concatenate([p.stability for p in parts]),
            np.concatenate([p.logits for p in parts]),
        )
