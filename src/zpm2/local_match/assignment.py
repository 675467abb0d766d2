"""The matching cost and its assignment: local-holistic bipartite graph optimization (paper 3.4.3)."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching

from zpm2.global_match import Candidates

Array = NDArray[np.float64]
DENSE = 64  # polygons of a side up to which a component is solved as a dense matrix


def matching_cost(
    psi: Array, dsf: NDArray[np.int64], texture: Array, gamma: int, epsilon: float, few_points: bool = False
) -> Array:
    """zeta of Eq. (cost), (c,), > 0: shape and DSF where there are enough points, else shape and texture.

    A negative correlation counts as none: the printed formula would turn it into a negative, most attractive cost.
    With `few_points`, points below gamma count for their share of it where texture says less: small polygons have few
    points, and little texture once their outlines differ by a pixel.
    """
    shared_points = np.maximum(texture, 0.0)
    if few_points:
        shared_points = np.maximum(shared_points, dsf / max(gamma, 1))
    similar = psi * np.where(dsf >= gamma, np.log(dsf + np.e), shared_points)
    return np.asarray(1.0 / (similar + epsilon))


def assign_optimal(pairs: Candidates, cost: Array, unmatched: float) -> NDArray[np.int64]:
    """LHBGO: which pairs are matched, as sorted rows of `pairs`; each polygon at most once.

    Components of the candidate graph do not influence each other, so each is one linear assignment of its own. A left
    polygon may stay unmatched at the price `unmatched`, the printed threshold iota; without a price the empty
    assignment would be the minimum. Pairs that cost as much or more are never taken.
    """
    usable = np.flatnonzero(cost < unmatched)
    if len(usable) == 0:
        return usable.astype(np.int64)
    _, i = np.unique(pairs.left[usable], return_inverse=True)
    _, j = np.unique(pairs.right[usable], return_inverse=True)
    m, n = int(i.max()) + 1, int(j.max()) + 1
    graph = coo_array((np.ones(len(i)), (i, m + j)), shape=(m + n, m + n))
    _, label = connected_components(graph, directed=False)
    component = label[i]
    order = np.argsort(component, kind="stable")
    starts = np.flatnonzero(np.diff(component[order], prepend=-1))
    chosen = []
    for part in np.split(order, starts[1:]):
        chosen.append(part if len(part) == 1 else part[_solve(i[part], j[part], cost[usable[part]], unmatched)])
    return np.sort(usable[np.concatenate(chosen)])


def assign_greedy(pairs: Candidates, psi: Array, cost: Array, unmatched: float) -> NDArray[np.int64]:
    """The ablation of 4.4.2: each left polygon in turn takes the free right polygon of highest psi."""
    usable = np.flatnonzero(cost < unmatched)
    usable = usable[np.lexsort((-psi[usable], pairs.left[usable]))]
    chosen, done, taken = [], set(), set()
    for row in usable:
        i, j = int(pairs.left[row]), int(pairs.right[row])
        if i not in done and j not in taken:
            chosen.append(row)
            done.add(i)
            taken.add(j)
    return np.sort(np.array(chosen, np.int64))


def _solve(i: NDArray[np.int64], j: NDArray[np.int64], cost: Array, unmatched: float) -> NDArray[np.int64]:
    """Rows of one component that are matched. Every left polygon has an "unmatched" column of its own."""
    _, i = np.unique(i, return_inverse=True)
    _, j = np.unique(j, return_inverse=True)
    m, n = int(i.max()) + 1, int(j.max()) + 1
    if max(m, n) <= DENSE:
        matrix = np.full((m, n + m), np.inf)
        matrix[i, j] = cost
        matrix[np.arange(m), n + np.arange(m)] = unmatched
        rows, columns = linear_sum_assignment(matrix)
    else:
        data = np.concatenate([cost, np.full(m, unmatched)])
        where = np.concatenate([i, np.arange(m)]), np.concatenate([j, n + np.arange(m)])
        rows, columns = min_weight_full_bipartite_matching(coo_array((data, where), shape=(m, n + m)).tocsr())
    partner = np.full(m, -1)
    partner[rows] = np.where(columns < n, columns, -1)
    return np.flatnonzero(partner[i] == j)
