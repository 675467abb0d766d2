"""Masks of the right photograph that may be a region of the left one.

Answers compete: those of the segmenter where the points put the region, those where it looks like the region, and the
outline of the region itself, only moved. Each counts by how well it agrees with the place and with the likeness; either
is enough. The likeness so overrules the points where they do not tell, or the photographs differ at their place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.config import CarryConfig
from zpm2.segment.inner_points import inner_points
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView
from zpm2.segment.suppression import boxes

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
FORMS = (0, 1, 3)  # points inside, of the prompts with a box


@dataclass(frozen=True, eq=False)
class Expectation:
    """What is expected of one region in the right photograph, px of a decoded mask."""

    place: Bits  # (h, w) where the points put it
    trust: float  # 0..1 in that
    exact: float  # 0..1, IoU that is expected of the region's own outline, moved there; 0: it takes no part
    like: NDArray[np.float32]  # (h, w) 0..1, how much it looks like the region
    weight: float  # 0..1 in that

    def by_place(self, bits: Bits, edge: float) -> Array:
        """(n,) 0..1, how well masks (n, h, w) agree with the place: the square of IoU, by the trust, as one that covers
        half of a place is more often another thing. The outline of a mask may be off by `edge` px, which is much of a
        small one."""
        area = int(self.place.sum())
        both = np.count_nonzero(bits & self.place, axis=(1, 2))
        iou = both / np.maximum(np.count_nonzero(bits, axis=(1, 2)) + area - both, 1)
        return np.asarray(self.trust * (iou * max(0.0, 1 - 4 * edge / max(area, 1) ** 0.5)) ** 2, np.float64)

    def by_likeness(self, bits: Bits) -> Array:
        """(n,) 0..1, how well masks (n, h, w) cover what looks like the region, and nothing else: soft IoU, by the
        weight."""
        both = np.einsum("nhw,hw->n", bits, self.like, dtype=np.float64)
        either = np.count_nonzero(bits, axis=(1, 2)) + self.like.sum(dtype=np.float64) - both
        return np.asarray(self.weight * both / np.maximum(either, 1e-9), np.float64)


@dataclass(frozen=True, eq=False)
class Answers:
    """Masks for one region, the best first."""

    masks: MaskPredictions
    agreement: Array  # (n,) 0..1, with what is expected
    by_place: Array  # (n,) 0..1, the part of the place in that
    moved: Bits  # (n,) the region's own outline at its place, nothing that the segmenter found

    def __len__(self) -> int:
        return len(self.agreement)

    @staticmethod
    def none(size: tuple[int, int]) -> "Answers":
        """No answer, in a view of `size` (height, width)."""
        return Answers(MaskPredictions.none(size), np.zeros(0), np.zeros(0), np.zeros(0, bool))


def ask(view: PromptedView, expected: Sequence[Expectation], config: CarryConfig) -> list[Answers]:
    """The answers for each region: those where the points put it; where none of them is sure, also those where it looks
    like the region. Prompts of one form go to the segmenter together."""
    by_place = {
        row: each.place
        for row, each in enumerate(expected)
        if each.trust >= config.min_trust and each.place.sum() >= config.min_pixels
    }
    found = _asked(view, by_place)
    best = [_ranked(view, found.get(row, []), each, config) for row, each in enumerate(expected)]
    by_likeness = {}
    for row, each in enumerate(expected):
        sure = best[row].by_place.max(initial=0.0) >= config.sure
        if not sure and each.weight > 0 and each.like.max() >= config.min_likeness:
            by_likeness[row] = each.like >= min(0.5, 0.5 * float(each.like.max()))
    for row, more in _asked(view, by_likeness).items():
        best[row] = _ranked(view, [*found.get(row, []), *more], expected[row], config)
    return best


def _asked(view: PromptedView, cores: Mapping[int, Bits]) -> dict[int, list[MaskPredictions]]:
    """By row, the masks for `cores` (h, w): the box of each, alone and with points inside."""
    points = {row: inner_points(core, max(FORMS)) for row, core in cores.items()}
    points = {row: each for row, each in points.items() if len(each)}
    box = {row: boxes(cores[row][None])[0].reshape(2, 2).astype(np.float64) for row in points}
    asked: dict[int, list[MaskPredictions]] = {row: [] for row in points}
    for count in FORMS:
        rows = [row for row, each in points.items() if len(each) >= count]
        if not rows:
            continue
        at = np.stack([np.concatenate([points[row][:count], box[row]]) for row in rows]) / view.mask_scale
        prompts = Prompts(at, np.array([INSIDE] * count + [CORNER, OTHER_CORNER]))
        masks = view.predict(prompts, MaskThresholds(0.5, 0.5))
        for k, row in enumerate(rows):
            asked[row].append(masks[masks.prompt == k])
    return asked


def _ranked(view: PromptedView, found: list[MaskPredictions], expected: Expectation, config: CarryConfig) -> Answers:
    masks = MaskPredictions.join([MaskPredictions.none(view.size), *found])
    bits = masks.bits
    by_place, by_likeness = expected.by_place(bits, config.edge_px), expected.by_likeness(bits)
    moved = np.zeros(len(masks), bool)
    if expected.exact > 0 and expected.place.any():
        own, one = expected.place[None], np.ones(1, np.float32)
        outline = MaskPredictions(np.zeros(1, np.int64), one, one, np.where(own, 1, -1).astype(np.float16))
        masks, moved = MaskPredictions.join([masks, outline]), np.append(moved, True)
        by_place = np.append(by_place, expected.trust * expected.exact**2)
        by_likeness = np.append(by_likeness, expected.by_likeness(own))
    agreement = 1 - (1 - by_place) * (1 - by_likeness)
    order = np.argsort(-agreement, kind="stable")[: config.kept]
    return Answers(masks[order], agreement[order], by_place[order], moved[order])
