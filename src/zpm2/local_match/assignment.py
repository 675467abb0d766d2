"""The matching cost and its assignment: local-holistic bipartite graph optimization (paper 3.4.3)."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates

Array = NDArray[np.float64]
DENSE_SIZE = 64  # polygons of a side up to which a component is solved as a dense matrix, which is faster then


def matching_cost(psi: Array, dsf: NDArray[np.int64], texture: Array, config: LocalConfig) -> Array:
    """(c,) zeta of Eq. (cost), > 0.

    It is computed from shape `psi` and DSF if there are `config.gamma` points, otherwise from shape and texture. A
    negative correlation counts as 0: the printed formula would turn it into a negative cost, which is the best one.
    With `config.few_points`, DSF / gamma replaces texture if it is larger: small polygons have few points, and hardly
    any texture once their outlines differ by a pixel.
    """
    spectral = np.maximum(texture, 0.0)
    if config.few_points:
        spectral = np.maximum(spectral, dsf / max(config.gamma, 1))
    similarity = psi * np.where(dsf >= config.gamma, np.log(dsf + np.e), spectral)
    return np.asarray(1.0 / (similarity + config.epsilon))


def assign_optimal(pairs: Candidates, cost: Array, unmatched: float) -> NDArray[np.int64]:
    """LHBGO: the sorted rows of `pairs` that are matched, each polygon at most once.

    Components of the candidate graph are independent, so each is one linear assignment. A left polygon may stay
    unmatched at the cost `unmatched`, the printed threshold iota; without that cost the empty assignment would be the
    minimum. Pairs that cost as much or more are never matched.
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
    """The ablation of 4.4.2: one left polygon after the other is matched with the free right polygon of highest psi."""
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
    """The matched rows of one component. Each left polygon has a column of its own for staying unmatched."""
    _, i = np.unique(i, return_inverse=True)
    _, j = np.unique(j, return_inverse=True)
    m, n = int(i.max()) + 1, int(j.max()) + 1
    if max(m, n) <= DENSE_SIZE:
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
