"""From locations to candidates: the right polygons in the final window of each left polygon (paper 3.3.2)."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import GlobalConfig
from zpm2.global_match.pyramid import PyramidLocations
from zpm2.model import PolygonArrays


@dataclass(frozen=True, eq=False)
class Candidates:
    """Pairs of polygons that may match (the paper's M in {0, 1}^(m x n), sparse): row `left[k]` and row `right[k]`.

    Rows, not ids. Sorted by left, then right, without repetitions.
    """

    left: NDArray[np.int64]  # (c,)
    right: NDArray[np.int64]  # (c,)

    def __len__(self) -> int:
        return len(self.left)

    @staticmethod
    def of(left: NDArray[np.int64], right: NDArray[np.int64]) -> "Candidates":
        """The pairs of (c,) rows, in any order and with repetitions."""
        pairs = np.unique(np.c_[left, right].astype(np.int64).reshape(-1, 2), axis=0)
        return Candidates(pairs[:, 0], pairs[:, 1])

    def __getitem__(self, rows: NDArray[np.intp]) -> "Candidates":
        return Candidates(self.left[rows], self.right[rows])


def search_candidates(
    left: PolygonArrays, right: PolygonArrays, locations: PyramidLocations, config: GlobalConfig
) -> Candidates:
    """The right polygons that touch the window W_final around each left polygon's location.

    W_final is phi x phi px. With `search = fixed` (the ablation of 4.4.1) half its side is the shorter side of the left
    polygon's bounding box.
    """
    usable = np.flatnonzero(np.isfinite(locations.centers).all(1))
    if len(usable) == 0 or len(right) == 0:
        return Candidates(np.zeros(0, np.int64), np.zeros(0, np.int64))
    half_side = np.full(len(usable), config.phi / 2.0)
    if config.search == "fixed":
        half_side = (left.bounds[usable, 2:] - left.bounds[usable, :2]).min(1)
    center = locations.centers[usable]
    windows = shapely.box(*(center - half_side[:, None]).T, *(center + half_side[:, None]).T)
    hit, row = shapely.STRtree(right.shapes).query(windows, predicate="intersects")
    return Candidates.of(usable[hit], row)
