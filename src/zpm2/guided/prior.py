"""What guided re-detection tells the matcher: where the left polygons should be, and which polygons it must doubt."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.global_match import Candidates
from zpm2.model import PolygonArrays
from zpm2.polygons.warp import WarpedPolygons

MIN_AGREEMENT = 1 / 3  # points inside both of those inside either, of a pair with a doubtful polygon


@dataclass(frozen=True, eq=False)
class GuidedPrior:
    """About m left and n right polygons."""

    warped: WarpedPolygons  # the left ones in the right image
    confident: tuple[NDArray[np.bool_], NDArray[np.bool_]]  # (m,), (n,) good enough without the other image
    guided: tuple[NDArray[np.bool_], NDArray[np.bool_]]  # (m,), (n,) found by asking about the other image's
    min_overlap: float  # 0..1, what a pair of which one is doubtful must overlap

    def candidates(self, known: Candidates, right: PolygonArrays) -> Candidates:
        """`known` and the right polygons that the carried ones meet."""
        i, j = shapely.STRtree(right.shapes).query(self.warped.shapes, predicate="intersects")
        return Candidates.of(np.append(known.left, i), np.append(known.right, j))

    def believes(
        self, pairs: Candidates, overlap: NDArray[np.float64], agreement: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """(c,) whether the two images agree on a pair where the segmenter was not sure of both polygons."""
        confident = self.confident[0][pairs.left] & self.confident[1][pairs.right]
        return np.asarray(confident | ((overlap >= self.min_overlap) & (agreement >= MIN_AGREEMENT)))

    def found(self, pairs: Candidates) -> NDArray[np.bool_]:
        """(c,) whether a pair exists because one image was asked about the other."""
        return np.asarray(self.guided[0][pairs.left] | self.guided[1][pairs.right])
