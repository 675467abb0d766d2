"""Networks that look at two images at once and give points of both, behind the protocol of all point matchers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import torch

from zpm2.config import PointsConfig
from zpm2.features.frame import Frame, frame
from zpm2.model import Image, PointMatches

# (b, 3, h, w) and (b, 3, h', w') RGB 0..1 -> of each pair (n, 2) and (n, 2) px with pixel centres at +0.5, (n,) scores
MatchPairs = Callable[[torch.Tensor, torch.Tensor], list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]]
CELL = 8  # px: such networks compare each cell of this side with each of the other image
BATCH = 16  # pairs that a network sees at a time
CELL_PAIRS = 2**26  # and pairs of cells: each takes 4 bytes, several times over


@dataclass(frozen=True, eq=False)
class PairNetworkMatcher:
    """A network as a point matcher. `frame` makes its input, and takes its points back to original px.

    `config.max_size` is the size that the network was trained for, or less.
    """

    name: str
    network: MatchPairs
    config: PointsConfig
    device: str

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`. At most `config.max_keypoints`, those of the best scores."""
        return self.match_many([(left, right)])[0]

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`. Pairs of equal sizes that follow each other are seen together."""
        found: list[PointMatches] = []
        for start in range(0, len(pairs), BATCH):
            frames = [[frame(side, self.config, self.device) for side in pair] for pair in pairs[start : start + BATCH]]
            for _, same in groupby(frames, lambda pair: [side.pixels.shape for side in pair]):
                same_size = list(same)
                cells = [side.pixels.shape[2] * side.pixels.shape[3] / CELL**2 for side in same_size[0]]
                at_once = max(1, int(CELL_PAIRS / (cells[0] * cells[1])))
                for first in range(0, len(same_size), at_once):
                    found += self._match(same_size[first : first + at_once])
        return found

    def _match(self, pairs: list[list[Frame]]) -> list[PointMatches]:
        """Of pairs of one size."""
        with torch.inference_mode():
            found = self.network(*(torch.cat([side.pixels for side in sides]) for sides in zip(*pairs, strict=True)))
            return [self._points(left, right, *of) for (left, right), of in zip(pairs, found, strict=True)]

    def _points(
        self, left: Frame, right: Frame, of_left: torch.Tensor, of_right: torch.Tensor, scores: torch.Tensor
    ) -> PointMatches:
        of_left, of_right = of_left - 0.5, of_right - 0.5  # as frames count
        keep = torch.nonzero(left.is_useful(of_left) & right.is_useful(of_right))[:, 0]
        best = torch.argsort(scores[keep], descending=True, stable=True)[: self.config.max_keypoints]
        rows = keep[best]
        score = np.clip(scores[rows].double().cpu().numpy(), 0.0, 1.0)
        return PointMatches(left.to_image(of_left[rows]), right.to_image(of_right[rows]), score)
