"""Shape: the graph descriptor, the node assignment and psi (paper 3.4.1).

Three formulas cannot be used as printed. They are read like this:

- The sum of angles of e_k^i grows with the number of vertices, which depends on the simplification. It is divided by
  N pi, so that e lies in 0..1 whatever N is.
- beta is printed as a SUM over vertices; exp(-z beta) would then vanish for any real polygon. It is the MEAN over the
  assigned vertices, and the distance of two embeddings is divided by the square root of their length.
- Indices run forwards along the closed ring (l from i to E(v_i, k), modulo N), and both rings turn the same way. Of
  two equally near vertices (as in a rectangle) the one that is reached first comes first, whichever vertex has index 0.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]
CHORD_CHUNK = 2**18  # chords that are computed at a time


def embedding(ring: Array, k: int) -> Array:
    """(N, min(k, N - 1)): the vector alpha_i of each vertex of a closed (N, 2) ring; entries in 0..1.

    Entry k of row i is the ratio of chord to path from v_i to its k-th nearest vertex, times the turning of that path.
    Invariant to translation, rotation and scale.
    """
    return np.asarray(_embed(ring[None], k)[0])


def embeddings(rings: Sequence[Array], k: int) -> list[Array]:
    """The embedding of each ring. Rings with equally many vertices are computed together."""
    result: list[Array] = [ring[:0] for ring in rings]
    vertices = np.array([len(ring) for ring in rings])
    for n in np.unique(vertices):
        rows, together = np.flatnonzero(vertices == n), max(1, CHORD_CHUNK // n**2)
        for start in range(0, len(rows), together):
            part = rows[start : start + together]
            for row, alpha in zip(part, _embed(np.stack([rings[row] for row in part]), k), strict=True):
                result[row] = alpha
    return result


def _embed(rings: Array, k: int) -> Array:
    """(g, N, 2) -> (g, N, min(k, N - 1))."""
    g, n, _ = rings.shape
    step = np.roll(rings, -1, axis=1) - rings
    length = np.hypot(step[..., 0], step[..., 1])
    incoming, outgoing = np.roll(step, 1, axis=1), step
    cross = incoming[..., 0] * outgoing[..., 1] - incoming[..., 1] * outgoing[..., 0]
    angle = np.pi - np.arctan2(np.abs(cross), (incoming * outgoing).sum(2))  # at each vertex, between its edges, 0..pi
    i, ahead = np.arange(n)[:, None], np.arange(1, n)
    away = rings[:, (i + ahead) % n] - rings[:, :, None]  # from v_i to the vertex that many edges ahead
    chord = np.hypot(away[..., 0], away[..., 1])
    near = np.round(chord / np.maximum(chord.max((1, 2), keepdims=True), 1e-300), 9)
    order = np.argsort(near, axis=2, kind="stable")[..., :k]
    walked, turned = (_prefix_sums(values)[np.arange(g)[:, None, None], i + ahead[order]] for values in (length, angle))
    walked = walked - _prefix_sums(length)[:, :n, None]
    turned = turned - _prefix_sums(angle)[:, 1 : n + 1, None]  # the vertices strictly between
    return np.asarray(np.take_along_axis(chord, order, axis=2) / np.maximum(walked, 1e-12) * turned / (n * np.pi))


def _prefix_sums(values: Array) -> Array:
    """(g, N) -> (g, 2 N + 1): sums of the first 0, 1, ... values, twice around the ring."""
    return np.concatenate([np.zeros((len(values), 1)), np.cumsum(np.tile(values, 2), axis=1)], axis=1)


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
    unique = {id(ring): ring for ring in [*rings, *others]}
    alpha = dict(zip(unique, embeddings(list(unique.values()), k), strict=True))
    results = [node_assignment(alpha[id(a)], alpha[id(b)]) for a, b in zip(rings, others, strict=True)]
    return np.exp(-z * np.array([beta for beta, _ in results])), [nodes for _, nodes in results]
