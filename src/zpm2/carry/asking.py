"""Masks of the right photograph that may be a region of the left one.

What is expected of a region is a picture of probabilities: its shape where the points put it, and its likeness, each by
its trust. The segmenter is asked there by points and box, and each answer counts by how much it covers of what is
expected and of nothing else (a soft IoU).
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
FORMS = (1, 3, 6)  # points inside, of the prompts with a box


@dataclass(frozen=True, eq=False)
class Expectation:
    """What is expected of one region in the right photograph, px of a decoded mask."""

    place: Bits  # (h, w) where the points put it
    trust: float  # 0..1 in that
    like: NDArray[np.float32]  # (h, w) 0..1, how much it looks like the region
    weight: float  # 0..1 in that

    @property
    def known(self) -> bool:
        """Whether anything is known at all."""
        return self.trust + self.weight > 0

    def picture(self) -> NDArray[np.float32]:
        """(h, w) 0..1, both together."""
        both = self.trust * self.place + self.weight * self.like
        return np.asarray(both / max(self.trust + self.weight, 1e-9), np.float32)


def agreed(place: Bits, trust: float, like: NDArray[np.float32], weight: float, config: CarryConfig) -> Expectation:
    """What is expected where the points put a region, with that `trust`, and where it looks like it.

    Points of the background seen through or beside a thing that moves put it where it was. So the trust in them falls
    as far as the place does not look like the region, and that can be told (`weight`).
    """
    both = float(like[place].sum())
    overlap = both / max(float(like.sum()) + float(place.sum()) - both, 1e-9)
    doubt = weight * max(0.0, 1 - overlap / config.looks_right)
    return Expectation(place, trust * (1 - doubt), like, weight)


@dataclass(frozen=True, eq=False)
class Answers:
    """Masks for one region, the best first."""

    masks: MaskPredictions
    agreement: Array  # (n,) 0..1, soft IoU with what is expected


def ask(view: PromptedView, expected: Sequence[Expectation], config: CarryConfig) -> list[Answers]:
    """The answers for each region: first where the points put it; where that gives nothing good, or they tell nothing,
    where it looks like the region. Prompts of one form go to the segmenter together."""
    pictures = [each.picture() for each in expected]
    by_place = {
        row: each.place
        for row, each in enumerate(expected)
        if each.trust >= config.min_trust and each.place.sum() >= config.min_pixels
    }
    found = _asked(view, by_place, FORMS[:2], alone=False)
    best = [_ranked(view, found.get(row, []), picture, config) for row, picture in enumerate(pictures)]
    by_likeness = {}
    for row, (each, picture) in enumerate(zip(expected, pictures, strict=True)):
        sure = len(best[row].agreement) and best[row].agreement[0] >= config.sure
        if not sure and each.weight > 0 and picture.max() >= config.min_likeness:
            by_likeness[row] = picture >= min(0.5, 0.5 * float(picture.max()))
    for row, more in _asked(view, by_likeness, FORMS, alone=True).items():
        best[row] = _ranked(view, [*found.get(row, []), *more], pictures[row], config)
    return best


def _asked(
    view: PromptedView, cores: Mapping[int, Bits], forms: Sequence[int], alone: bool
) -> dict[int, list[MaskPredictions]]:
    """By row, the masks for `cores` (h, w): the box of each with several points inside, and if `alone` also these
    without the box."""
    points = {row: inner_points(core, max(forms)) for row, core in cores.items()}
    points = {row: each for row, each in points.items() if len(each)}
    box = {row: boxes(cores[row][None])[0].reshape(2, 2).astype(np.float64) for row in points}
    asked: dict[int, list[MaskPredictions]] = {row: [] for row in points}

    def together(prompts: list[tuple[int, Array]], labels: list[int]) -> None:
        """Asks with prompts (row, points) of one form."""
        if not prompts:
            return
        at = np.stack([each for _, each in prompts]) / view.mask_scale
        masks = view.predict(Prompts(at, np.array(labels)), MaskThresholds(0.5, 0.5))
        for k, (row, _) in enumerate(prompts):
            asked[row].append(masks[masks.prompt == k])

    for count in forms:
        framed = [(row, np.concatenate([each[:count], box[row]])) for row, each in points.items() if len(each) >= count]
        together(framed, [INSIDE] * count + [CORNER, OTHER_CORNER])
    if alone:
        together([(row, point[None]) for row, each in points.items() for point in each[:3]], [INSIDE])
        together([(row, each[:3]) for row, each in points.items() if len(each) >= 3], [INSIDE] * 3)
    return asked


def _ranked(
    view: PromptedView, found: list[MaskPredictions], picture: NDArray[np.float32], config: CarryConfig
) -> Answers:
    masks = MaskPredictions.join([MaskPredictions.none(view.size), *found])
    bits = masks.bits
    wanted, covered = picture.sum(dtype=np.float64), np.count_nonzero(bits, axis=(1, 2))
    both = np.einsum("nhw,hw->n", bits, picture, dtype=np.float64)
    agreement = both / np.maximum(wanted + covered - both, 1e-9)
    order = np.argsort(-agreement, kind="stable")[: config.kept]
    return Answers(masks[order], agreement[order])
