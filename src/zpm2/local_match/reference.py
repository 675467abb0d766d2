"""The local matcher's equations (paper 3.4) in plain loops: for reading, and to test the fast forms with.

Where the paper leaves a choice, it is made as `shape.py`, `shared_points.py` and `assignment.py` state. Clear rather
than fast: optima are found by trying everything, or by one linear assignment over all polygons.
"""

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from zpm2.model import PointMatches, Polygon

Array = NDArray[np.float64]


def embedding(ring: Array, k: int) -> Array:
    """alpha_i of 3.4.1 for each vertex of a closed (N, 2) ring: (N, min(k, N - 1))."""
    n = len(ring)
    longest = max(math.dist(u, v) for u in ring for v in ring)
    alpha = np.zeros((n, min(k, n - 1)))
    for i in range(n):

        def d(ahead: int, i: int = i) -> float:
            return math.dist(ring[i], ring[(i + ahead) % n])

        nearest = sorted(
            range(1, n), key=lambda ahead: (round(d(ahead) / longest, 9), ahead)
        )  # E(v_i, 1), E(v_i, 2) ...
        for place, ahead in enumerate(nearest[: alpha.shape[1]]):
            walked = sum(math.dist(ring[el % n], ring[(el + 1) % n]) for el in range(i, i + ahead))
            turned = sum(_angle(ring[el % n], ring[(el + 1) % n], ring[(el + 2) % n]) for el in range(i, i + ahead - 1))
            alpha[i, place] = d(ahead) / walked * turned / (n * math.pi)
    return alpha


def geometric_discrepancy(first: Array, second: Array) -> tuple[float, set[tuple[int, int]]]:
    """beta and M_node of two embeddings, the fewest-weight one of ALL assignments of the smaller vertex set."""
    if len(first) > len(second):
        beta, nodes = geometric_discrepancy(second, first)
        return beta, {(u, v) for v, u in nodes}
    k = min(first.shape[1], second.shape[1])
    w = [[math.dist(u[:k], v[:k]) / math.sqrt(k) for v in second] for u in first]
    best = min(
        itertools.permutations(range(len(second)), len(first)), key=lambda p: sum(w[u][v] for u, v in enumerate(p))
    )
    return sum(w[u][v] for u, v in enumerate(best)) / len(first), set(enumerate(best))


def similarity(eta_i: float, eta_j: float, beta: float, z: float) -> float:
    """psi of Eq. (geo), from the areas and beta."""
    return (1 - abs((eta_i - eta_j) / max(eta_i, eta_j))) * math.exp(-z * beta)


def deep_spectral_factor(points: PointMatches, left: Polygon, right: Polygon) -> int:
    """chi of 3.4.2: homologous points with one end inside each polygon."""
    inside = 0
    for p, q in zip(points.left, points.right, strict=True):
        inside += left.shape.contains(shapely.Point(p)) and right.shape.contains(shapely.Point(q))
    return inside


def cost(psi: float, chi: int, texture: float, gamma: int, epsilon: float) -> float:
    """zeta of Eq. (cost). A negative R counts as none."""
    if chi >= gamma:
        return 1 / (psi * math.log(chi + math.e) + epsilon)
    return 1 / (psi * max(texture, 0.0) + epsilon)


def assign_exhaustive(costs: Mapping[tuple[int, int], float], unmatched: float) -> tuple[float, set[tuple[int, int]]]:
    """LHBGO by trying every one-to-one subset of the pairs (i, j): its energy and its pairs.

    Energy is the sum of zeta over the matched, and `unmatched` for every other left polygon that has a pair.
    """
    rows = sorted({i for i, _ in costs})
    if not rows:
        return 0.0, set()
    i, rest = rows[0], {pair: c for pair, c in costs.items() if pair[0] != rows[0]}
    energy, chosen = assign_exhaustive(rest, unmatched)
    best = energy + unmatched, chosen
    for (row, j), price in costs.items():
        if row != i or price >= unmatched:
            continue
        energy, chosen = assign_exhaustive({p: c if p[1] != j else math.inf for p, c in rest.items()}, unmatched)
        if energy + price < best[0]:
            best = energy + price, chosen | {(i, j)}
    return best


def assign_dense(costs: Mapping[tuple[int, int], float], unmatched: float) -> tuple[float, set[tuple[int, int]]]:
    """The same by one linear assignment over all polygons, with a column "unmatched" for each left one."""
    rows, columns = sorted({i for i, _ in costs}), sorted({j for _, j in costs})
    m, n = len(rows), len(columns)
    matrix = np.full((m, n + m), np.inf)
    for (i, j), price in costs.items():
        if price < unmatched:
            matrix[rows.index(i), columns.index(j)] = price
    for i in range(m):
        matrix[i, n + i] = unmatched
    solution = list(zip(*linear_sum_assignment(matrix), strict=True))
    return float(sum(matrix[i, j] for i, j in solution)), {(rows[i], columns[j]) for i, j in solution if j < n}


def once_around(costs: Sequence[Sequence[float]]) -> float:
    """The least sum of costs of a walk once around two closed outlines (`outline.align`), by trying every start.

    `costs[i][j]` is that of pairing place i of the first with place j of the second; a walk goes on by one place on the
    first, the second or both, and ends where it began.
    """
    p, q = len(costs), len(costs[0])
    best = math.inf
    for start in range(q):
        total = [[math.inf] * (q + 1) for _ in range(p + 1)]
        for i, j in itertools.product(range(p + 1), range(q + 1)):
            before = [total[a][b] for a, b in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if a >= 0 and b >= 0]
            here = 0.0 if (i, j) == (p, q) else costs[i % p][(start + j) % q]
            total[i][j] = here + min(before, default=0.0)
        best = min(best, total[p][q])
    return best


def _angle(a: Array, b: Array, c: Array) -> float:
    """Angle between the edges b-a and b-c, 0..pi."""
    u, v = a - b, c - b
    return abs(math.atan2(u[0] * v[1] - u[1] * v[0], u @ v))
