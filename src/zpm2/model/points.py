"""Point correspondences between two images."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Homologous points: row k of `left` is the same scene point as row k of `right`."""

    left: NDArray[np.float64]  # (n, 2) image px, pixel centres at +0.5
    right: NDArray[np.float64]  # (n, 2) image px
    score: NDArray[np.float64]  # (n,) 0..1, the matcher's own

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "PointMatches":
        return PointMatches(self.left[rows], self.right[rows], self.score[rows])

    @staticmethod
    def empty() -> "PointMatches":
        return PointMatches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
