"""Prompts and the masks that a promptable segmenter predicts for them, at the resolution at which it decodes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.segment import stacks
from zpm2.segment.stacks import BitStack, Extent, Stack

MASK_SIDE = 256  # px, longer side of a decoded mask

OUTSIDE, INSIDE, CORNER, OTHER_CORNER = 0, 1, 2, 3  # labels of a prompt's points


@dataclass(frozen=True, eq=False)
class Prompts:
    """n prompts of one form: each has the same number of points, with the same labels."""

    points: NDArray[np.float64]  # (n, P, 2) image px
    labels: NDArray[np.int64]  # (P,) INSIDE for a point of the region, OUTSIDE for one of the rest, else its box

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
    """Masks of one view, several per prompt or none. Their pixels may be on a GPU (`stacks`)."""

    prompt: NDArray[np.int64]  # (n,) row of the prompt
    score: NDArray[np.float32]  # (n,) predicted IoU
    stability: NDArray[np.float32]  # (n,)
    logits: Stack  # (n, h, w) half precision, of the view's `size`, inside where > 0
    measured: Extent | None = None  # where they lie, if that is known already

    def __len__(self) -> int:
        return len(self.prompt)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "MaskPredictions":
        if rows.dtype == np.bool_:
            if rows.all():
                return self
            rows = np.flatnonzero(rows)
        measured = None if self.measured is None else self.measured[rows]
        logits = stacks.take(self.logits, np.asarray(rows, np.intp))
        return MaskPredictions(self.prompt[rows], self.score[rows], self.stability[rows], logits, measured)

    def passing(self, thresholds: MaskThresholds) -> NDArray[np.bool_]:
        """(n,) which of them reach the thresholds."""
        return np.asarray((self.score >= thresholds.predicted_iou) & (self.stability >= thresholds.stability))

    @property
    def extent(self) -> Extent:
        """Area and box of each mask."""
        if self.measured is None:
            object.__setattr__(self, "measured", stacks.extent(self.logits))
        assert self.measured is not None
        return self.measured

    @property
    def inside(self) -> BitStack:
        """(n, h, w) the masks, where their logits are."""
        return stacks.inside(self.logits)

    @property
    def bits(self) -> NDArray[np.bool_]:
        """(n, h, w) the masks, on the host: all of their pixels cross where they are on a GPU."""
        return stacks.to_host(self.inside)

    @staticmethod
    def none(size: tuple[int, int]) -> "MaskPredictions":
        """No mask, of a view of `size` (height, width)."""
        nothing = np.zeros(0, np.float32)
        nowhere = Extent(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
        return MaskPredictions(np.zeros(0, np.int64), nothing, nothing, np.zeros((0, *size), np.float16), nowhere)

    @staticmethod
    def join(parts: "list[MaskPredictions]") -> "MaskPredictions":
        """The masks of one or more parts, one after the other. Each part keeps its own rows of prompts."""
        parts = [part for part in parts if len(part)] or parts[:1]
        if len(parts) == 1:
            return parts[0]
        known = [part.measured for part in parts if part.measured is not None]
        measured = Extent.join(known) if len(known) == len(parts) else None
        return MaskPredictions(
            np.concatenate([p.prompt for p in parts]),
            np.concatenate([p.score for p in parts]),
            np.concatenate([p.stability for p in parts]),
            stacks.join([p.logits for p in parts]),
            measured,
        )

    @staticmethod
    def chosen(parts: "Sequence[MaskPredictions]", rows: NDArray[np.intp]) -> "MaskPredictions":
        """The masks `rows` of `join(parts)`, of which no others are copied."""
        ends = np.cumsum([len(part) for part in parts])
        of = np.searchsorted(ends, rows, side="right")
        first = ends - [len(part) for part in parts]
        return MaskPredictions(
            np.concatenate([part.prompt for part in parts])[rows],
            np.concatenate([part.score for part in parts])[rows],
            np.concatenate([part.stability for part in parts])[rows],
            stacks.chosen([part.logits for part in parts], of, rows - first[of]),
            Extent.join([part.extent for part in parts])[rows],
        )
