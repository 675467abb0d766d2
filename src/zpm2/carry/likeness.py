"""Where the right photograph looks like a region of the left one, by the segmenter's own embedding.

Each cell of the right embedding takes the labels of the cells of the left one that are most like it (k nearest
neighbours, as in space-time correspondence: Jabri et al., NeurIPS 2020). Regions and background compete for each cell,
so that a cell that is as much like the background says nothing. No geometry takes part: it finds what moved on its own,
and tells nothing of regions smaller than a cell.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.config import CarryConfig
from zpm2.polygons.rasterize import cell_shares

Array = NDArray[np.float64]
ROWS = 1024  # cells that are compared at a time


@dataclass(frozen=True, eq=False)
class Cells:
    """An embedding: a grid of cells over a photograph."""

    vectors: NDArray[np.float32]  # (h * w, c) of length 1, without the mean of both photographs
    size: tuple[int, int]  # (h, w)
    scale: float  # cells per image px

    def shares(self, shapes: NDArray[np.object_]) -> Array:
        """(n, h * w) share of each cell inside each of (n,) shapes, image px."""
        return cell_shares(shapes, self.scale, self.size[::-1]).reshape(len(shapes), -1)


def cells_of(left: NDArray[np.float32], right: NDArray[np.float32], scales: tuple[float, float]) -> tuple[Cells, Cells]:
    """The embeddings (c, h, w) of both photographs, made comparable: the mean of both is taken off."""
    flat = [np.asarray(each, np.float64).reshape(len(each), -1).T for each in (left, right)]
    mean = np.concatenate(flat).mean(0)
    sides = []
    for each, values, scale in zip((left, right), flat, scales, strict=True):
        centred = values - mean
        centred /= np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-12)
        sides.append(Cells(centred.astype(np.float32), (each.shape[1], each.shape[2]), scale))
    return sides[0], sides[1]


def transferred(source: Cells, target: Cells, shares: Array, config: CarryConfig) -> Array:
    """(n, h, w) 0..1, how much each cell of `target` is like each region, whose `shares` (n, cells) of the cells of
    `source` are given."""
    found = np.empty((len(shares), len(target.vectors)))
    k = min(config.neighbors, len(source.vectors))
    for start in range(0, len(target.vectors), ROWS):
        part = slice(start, start + ROWS)
        cosine = target.vectors[part] @ source.vectors.T
        least = np.partition(cosine, -k, axis=1)[:, -k, None]
        weight = np.where(cosine >= least, np.exp((cosine - 1) / config.temperature), 0.0)
        weight /= weight.sum(1, keepdims=True)
        found[:, part] = shares @ weight.T
    return found.reshape(len(shares), *target.size)
