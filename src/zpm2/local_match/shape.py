"""Shape: the graph descriptor, the node assignment and psi (paper 3.4.1).

Three things cannot be used as printed, and are read like this:

- The sum of angles of e_k^i grows with the number of vertices, which depends on the simplification. It is divided by
  N pi, so that e lies in 0..1 whatever N is.
- beta is printed as a SUM over vertices; exp(-z beta) would then vanish for any real polygon. It is the MEAN over the
  assigned vertices, and the distance of two embeddings is divided by the square root of their length.
- Indices run forwards along the closed ring (l from i to E(v_i, k), modulo N), and both rings turn the same way. Of
  two vertices equally near (a rectangle has them) the one met first comes first, whichever vertex is numbered 0.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]


def embedding(ring: Array, k: int) -> Array:
    """(N, min(k, N - 1)): the vector alpha_i of each vertex of a closed (N, 2) ring; entries in 0..1.

    Entry k of row i is the ratio of chord to path from v_i to its k-th nearest vertex, times the turning of that path.
    Invariant to translation, rotation and scale.
    """
    n = len(ring)
    k = min(k, n - 1)
    step = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(step[:, 0], step[:, 1])
    incoming, outgoing = np.roll(step, 1, axis=0), step
    cross = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
    dot = (incoming * outgoing).sum(1)
    angle = np.pi - np.arctan2(np.abs(cross), dot)  # at each vertex, between its two edges, 0..pi
    i, ahead = np.arange(n)[:, None], np.arange(1, n)
    chord = cdist(ring, ring)[i, (i + ahead) % n]  # from v_i to the vertex that many edges ahead
    order = np.argsort(np.round(chord / max(chord.max(), 1e-300), 9), axis=1, kind="stable")[:, :k]
    chord, ahead = np.take_along_axis(chord, order, axis=1), ahead[order]
    path = np.concatenate([[0.0], np.cumsum(np.tile(length, 2))])
    turning = np.concatenate([[0.0], np.cumsum(np.tile(angle, 2))])
    walked = path[i + ahead] - path[i]
    turned = turning[i + ahead] - turning[i + 1]  # the vertices strictly between
    return np.asarray(chord / np.maximum(walked, 1e-12) * turned / (n * np.pi))


def node_assignment(first: Array, second: Array) -> tuple[float, NDArray[np.int64]]:
    """beta and the homologous vertices of two polygons, from their embeddings (N, k) and (N', k').

    beta is the mean weight of the optimal assignment of the smaller vertex set into the larger; the (min(N, N'), 2)
    rows are pairs of vertex indices. Embeddings of different length are compared over their common part.
    """
    k = min(first.shape[1], second.shape[1])
    weights = cdist(first[:, :k], second[:, :k]) / np.sqrt(k)
    rows, columns = linear_sum_assignment(weights)
    return float(weights[rows, columns].mean()), np.c_[rows, columns].astype(np.int64)


def area_ratio(first: Array, second: Array) -> Array:
    """(c,) the area term of Eq. (geo): 1 - |(a - b) / max(a, b)| = min / max."""
    return np.asarray(np.minimum(first, second) / np.maximum(np.maximum(first, second), 1e-300))


def graph_similarity(
    rings: list[Array], others: list[Array], z: float, k: int
) -> tuple[Array, list[NDArray[np.int64]]]:
    """exp(-z beta) for each pair of rings, and its homologous vertices."""
    known: dict[int, Array] = {}

    def embed(ring: Array) -> Array:
        if id(ring) not in known:
            known[id(ring)] = embedding(ring, k)
        return known[id(ring)]

    results = [node_assignment(embed(a), embed(b)) for a, b in zip(rings, others, strict=True)]
    return np.exp(-z * np.array([beta for beta, _ in results])), [nodes for _, nodes in results]
