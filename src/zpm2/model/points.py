"""Point correspondences between two images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.model.brief import brief


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Homologous points: row k of `left` is the same scene point as row k of `right`."""

    left: NDArray[np.float64]  # (n, 2) image px, pixel centres at +0.5
    right: NDArray[np.float64]  # (n, 2) image px
    score: NDArray[np.float64]  # (n,) 0..1, the matcher's own

    __repr__ = brief

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "PointMatches":
        return PointMatches(self.left[rows], self.right[rows], self.score[rows])

    @staticmethod
    def join(parts: "Sequence[PointMatches]") -> "PointMatches":
        """One after the other."""
        parts = parts or [PointMatches.empty()]
        return PointMatches(
            np.concatenate([p.left for p in parts]),
            np.concatenate([p.right for p in parts]),
            np.concatenate([p.score for p in parts]),
        )

    @staticmethod
    def empty() -> "PointMatches":
        return PointMatches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
