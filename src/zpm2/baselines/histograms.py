"""Log-polar histograms, and the chi-square cost of many of them against many others."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import ConfigError

Array = NDArray[np.float64]
Costs = NDArray[np.float32]
Counts = NDArray[np.uint16]

INNER_RADIUS, OUTER_RADIUS = 0.125, 2.0  # of the mean distance, bounds of the rings (Belongie et al. 2002)
COSTS_AT_ONCE = 2**20  # chi-square costs, to bound the memory


def check_bins(samples: int, rings: int, sectors: int, limit: float) -> None:
    """`ConfigError` for settings of a descriptor that cannot be used."""
    if not 3 <= samples <= 1000 or rings < 1 or sectors < 1 or not 0 < limit <= 1:
        raise ConfigError(
            "a shape descriptor needs 3 to 1000 samples, at least 1 ring and 1 sector, and a limit in (0, 1], "
            f"got {samples}, {rings}, {sectors} and {limit}"
        )


def log_polar(distance: Array, angle: Array, rings: int, sectors: int) -> Counts:
    """(n, rings * sectors): how many of the other points lie in which bin, seen from each of n points.

    `distance` and `angle` (radians) are (n, n), row i as seen from point i; the diagonal is not counted. Distances are
    divided by their mean. Rings are bounded by equal steps of the logarithm from 1/8 to 2; the innermost reaches
    down to 0 and the outermost has no end, so that every point is counted and all rows have the sum n - 1. Sectors
    are centred at 0, 2 pi / sectors, ...: straight and right-angled outlines lie within bins, not on their limits.
    """
    n = len(distance)
    other = ~np.eye(n, dtype=bool)
    ratio = distance[other] / distance[other].mean()
    ring = np.searchsorted(np.geomspace(INNER_RADIUS, OUTER_RADIUS, rings)[:-1], ratio, side="right")
    sector = np.floor(angle[other] * sectors / (2 * np.pi) + 0.5).astype(np.int64) % sectors
    bins = rings * sectors
    row = np.repeat(np.arange(n), n - 1)
    counts = np.bincount((row * rings + ring) * sectors + sector, minlength=n * bins)
    return counts.reshape(n, bins).astype(np.uint16)


def chi_square(first: Counts, second: Counts) -> Costs:
    """(n, m) cost 0..1 of each of the (n, b) histograms against each of the (m, b): half the chi-square distance.

    sum_k (g_k - h_k)^2 / (g_k + h_k) / 2 of the histograms divided by their sums, which must all be the same
    (C_ij of Belongie et al. 2002), with an error below 1e-5.
    """
    total = int(first[0].sum())
    return _distance(_embed(first, total), _embed(second, total))


def compare(
    left: Counts, right: Counts, align: Callable[[Costs], Array], progress: Callable[[float], None] = lambda share: None
) -> Array:
    """(p, q) distance of every left shape to every right one. Shapes are (p, n, b) and (q, n, b) histograms.

    `align` turns the (c, n, n) chi-square costs of c pairs into their (c,) distances. Only the result grows with p * q:
    costs are made for blocks of pairs. `progress` gets the share that is done, 0..1.
    """
    (p, n, bins), q = left.shape, len(right)
    result = np.zeros((p, q))
    width = max(1, min(q, COSTS_AT_ONCE // n**2))
    for start in range(0, q, width):
        block = right[start : start + width]
        columns = _embed(block.reshape(-1, bins), n - 1)
        for i in range(p):
            costs = _distance(_embed(left[i], n - 1), columns)
            result[i, start : start + width] = align(costs.reshape(n, len(block), n).transpose(1, 0, 2))
            progress((start * p + (i + 1) * len(block)) / (p * q))
    return result


def _distance(first: NDArray[np.float32], second: NDArray[np.float32]) -> Costs:
    return np.asarray(np.maximum(np.float32(1) - first @ second.T, np.float32(0)))


def _embed(counts: Counts, total: int) -> NDArray[np.float32]:
    """(n, b) histograms as (n, b * r) vectors whose inner products are 1 - chi_square, see `_table`."""
    return np.asarray(_table(total)[counts].reshape(len(counts), -1))


@cache
def _table(total: int) -> NDArray[np.float32]:
    """(total + 1, r): row a is a vector for the count a, with row a . row b = 2 a b / (a + b) / total.

    (a - b)^2 / (a + b) = a + b - 4 a b / (a + b), so half the chi-square distance of two histograms of the same total
    is 1 minus the sum of these products, and all costs of many histograms are one matrix product. The kernel is
    positive definite (Vedaldi and Zisserman, PAMI 2012) and its eigenvalues fall so fast that r is about twelve.
    """
    a = np.arange(1.0, total + 1)
    values, vectors = np.linalg.eigh(2 * np.outer(a, a) / np.add.outer(a, a) / total)
    kept = values > 1e-10 * values[-1]
    rows = vectors[:, kept] * np.sqrt(values[kept])
    return np.concatenate([np.zeros((1, rows.shape[1])), rows]).astype(np.float32)
