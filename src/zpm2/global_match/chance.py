"""Whether a geometry is more than chance, and whether a camera can have seen it.

In any two photographs, some points agree on some epipolar geometry. Whether more agree than by chance is tested a
contrario (Moisan and Stival, A probabilistic criterion to detect rigid point matches between two images, IJCV 2004).
Samples of the points define many geometries. The test is the expected number of these on which as many points would
agree if each left point had a random partner. Two things differ from that publication, as the points of unrelated
photographs are not spread evenly. The chance that a pair agrees is measured on the same points with other partners, not
computed from areas. Points close to each other in both images show the same texture, so they are not independent
evidence and count once.
"""

from math import lgamma, log, log10

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.config import ChanceConfig
from zpm2.features.combined import distinct
from zpm2.model import PointMatches

Array = NDArray[np.float64]
MIRRORED = "one of the photographs is mirrored: each shows the scene turned over in the other, as no two cameras see it"


def log_chance(
    matrix: Array, points: PointMatches, agree: NDArray[np.bool_], sample: int, models: int, config: ChanceConfig
) -> float:
    """log10 of how many epipolar geometries at least as good as `matrix` (3 x 3) are expected by chance.

    At least as good: as many of the homologous `points` (n, 2), px, agree as closely as those of `agree` (n,). `sample`
    points define up to `models` geometries (7 and 3 for F, 5 and 10 for E). Positive where too few points agree to
    tell. `points` are all that were found, those of repeated searches too: each is one more chance to agree.
    """
    noise = float(geometry.sampson_distance(matrix, points.left, points.right)[agree].max(initial=0.0))
    kept = _independent(points, config)
    points, agree = points[kept], agree[kept]
    total, agreeing = len(points), int(agree.sum())
    if agreeing <= sample:
        return log10(max(total - sample, 1)) + log10(models)
    some = points[np.arange(0, total, total // config.max_compared + 1)]
    near = geometry.sampson_table(matrix, some.left, some.right) <= noise
    np.fill_diagonal(near, False)
    return _log_expected(total, agreeing, _share(near), sample, models)


def log_chance_of_map(distances: Array, reach: float, sample: int) -> float:
    """log10 of how many maps from `sample` of n points are expected by chance to agree as well; 0 where no more agree.

    `distances` (n, n) px: from each left point, mapped, to each right point; its own is on the diagonal.
    """
    near = distances <= reach
    total, agreeing = len(near), int(np.diag(near).sum())
    if agreeing <= sample:
        return 0.0
    np.fill_diagonal(near, False)
    return _log_expected(total, agreeing, _share(near), sample, 1)


def _share(near: NDArray[np.bool_]) -> float:
    """Of the pairs of n points with each other's partners, those that agree; (n, n), its diagonal False."""
    n = len(near)
    return float((near.sum() + 1) / (n * (n - 1) + 1))


def _log_expected(total: int, agreeing: int, share: float, sample: int, models: int) -> float:
    """log10 of the expected number of models on which `agreeing` of `total` points agree, each by a chance of
    `share`."""
    tests = log10(max(total - sample, 1)) + log10(models)
    ways = _log_choices(total, agreeing) + _log_choices(agreeing, sample)
    return float(tests + ways + (agreeing - sample) * np.log10(share))


def same_scene(chance: float, config: ChanceConfig) -> float:
    """The probability, 0..1, that both photographs show the same scene, from the `log_chance` of their geometry.

    It falls as `chance` rises, from 1 to `config.unsupported`: where no geometry was found, the pair may just be too
    hard. Half-way is `config.significance`.
    """
    odds = 10.0 ** float(np.clip((chance + config.significance) / config.scene_width, -300, 300))
    return config.unsupported + (1 - config.unsupported) / (1 + odds)


def is_mirrored(points: PointMatches, agree: NDArray[np.bool_], config: ChanceConfig) -> bool:
    """Whether one image shows the scene turned over around most of the points that `agree` (n,), as no camera sees it.

    Around each point an affine map is fitted to the nearer half of the others; it turns over where its determinant is
    negative. Half of all points, as matchers find small pieces of a mirror image that are not turned over themselves:
    their order tells.
    """
    some = points[agree]
    some = some[_independent(some, config)]
    some = some[np.arange(0, len(some), len(some) // config.max_compared + 1)]
    if len(some) < config.min_mirror_points:
        return False
    _, near = cKDTree(some.left).query(some.left, k=len(some) // 2)
    here, there = (side[near] - side[:, None] for side in (some.left, some.right))
    return bool((np.linalg.det(here.transpose(0, 2, 1) @ there) < 0).mean() > config.min_mirrored)


def _independent(points: PointMatches, config: ChanceConfig) -> NDArray[np.intp]:
    """Rows of points no two of which are close to each other in both images."""
    rows = np.arange(0, len(points), len(points) // config.max_points + 1)
    return rows[distinct(points[rows], config.independent_distance)]


def _log_choices(n: int, k: int) -> float:
    """log10 of the ways to choose k of n."""
    return (lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)) / log(10)
