"""What a geometry is worth as evidence: whether it is more than chance, and whether a camera can have seen it.

Some points of any two photographs agree on some epipolar geometry. How many do so by chance is counted a contrario
(Moisan and Stival, A probabilistic criterion to detect rigid point matches between two images, IJCV 2004): the expected
number of geometries, among all that samples of the points define, on which as many of them would agree if each left
point had a partner at random. Two things differ from the paper, since the points of unrelated photographs are not
spread evenly. The chance that a pair agrees is measured, on the same points paired anew, and not taken from areas. And
points close to each other in both images see the same texture, and so are no independent evidence: they count once.
"""

from math import lgamma, log, log10

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.features.combined import distinct
from zpm2.model import PointMatches

Array = NDArray[np.float64]
APART = 16.0  # px, in both images: closer points count once; descriptors of networks are read from cells of 8 px
MOST = 500  # points that are compared each with each other, evenly taken from more
CHANCE = -8.0  # log10 of the expected number, above which a geometry is taken for chance; docs/confidence.md
FEWEST, OVER = 10, 0.5  # points, and share of them that are turned over, from which an image is mirrored
TRIED = 20_000  # points that are looked at, evenly taken from more
MIRRORED = "one of the photographs is mirrored: each shows the scene turned over in the other, as no two cameras see it"


def log_chance(matrix: Array, points: PointMatches, agree: NDArray[np.bool_], sample: int, models: int) -> float:
    """log10 of how many epipolar geometries at least as good as `matrix` (3 x 3) are expected by chance.

    Good means: as many of the homologous `points` (n, 2), px, `agree` (n,) as closely. `sample` points define up to
    `models` geometries (7 and 3 for F, 5 and 10 for E). Positive where too few points agree to say anything. All points
    that were tried must be given, those of further looks too: each is one more chance.
    """
    noise = float(geometry.sampson_distance(matrix, points.left, points.right)[agree].max(initial=0.0))
    kept = _apart(points)
    points, agree = points[kept], agree[kept]
    total, agreeing = len(points), int(agree.sum())
    tests = log10(max(total - sample, 1)) + log10(models)
    if agreeing <= sample:
        return tests
    some = points[np.arange(0, total, total // MOST + 1)]
    near = geometry.sampson_table(matrix, some.left, some.right) <= noise
    np.fill_diagonal(near, False)
    share = (near.sum() + 1) / (len(some) * (len(some) - 1) + 1)
    ways = _log_choices(total, agreeing) + _log_choices(agreeing, sample)
    return float(tests + ways + (agreeing - sample) * np.log10(share))


def is_mirrored(points: PointMatches, agree: NDArray[np.bool_]) -> bool:
    """Whether around most of the points that `agree` (n,) the other image is turned over, as no camera sees a scene.

    Around a point is the nearer half of the others: matchers find pieces of a mirror image that are not turned over
    themselves, and it is their order that tells. It is over where the determinant of the affine map is negative.
    """
    some = points[agree]
    some = some[_apart(some)]
    some = some[np.arange(0, len(some), len(some) // MOST + 1)]
    if len(some) < FEWEST:
        return False
    _, near = cKDTree(some.left).query(some.left, k=len(some) // 2)
    here, there = (side[near] - side[:, None] for side in (some.left, some.right))
    return bool((np.linalg.det(here.transpose(0, 2, 1) @ there) < 0).mean() > OVER)


def _apart(points: PointMatches) -> NDArray[np.intp]:
    """Rows of points no two of which are close to each other in both images."""
    rows = np.arange(0, len(points), len(points) // TRIED + 1)
    return rows[distinct(points[rows], APART)]


def _log_choices(n: int, k: int) -> float:
    """log10 of the ways to choose k of n."""
    return (lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)) / log(10)
