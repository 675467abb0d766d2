"""The binary partition tree of an image (Salembier & Garrido, IEEE TIP 2000): regions of every size, each in the next.

Its leaves are the catchment basins of a watershed. Then the two neighbours whose colours differ least are merged, again
and again, until one region is left. How little that is grows with their areas (Ward 1963), so small regions go first.
"""

import heapq
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Count = NDArray[np.int64]
NEAREST = 3  # px: minima of the gradient closer than this are one
LEVELS = 4095  # steps of the gradient, of which the watershed takes whole numbers


@dataclass(frozen=True, eq=False)
class PartitionTree:
    """n nodes: leaves first, then merged regions in the order in which they were made; the last is the whole image."""

    rank: Count  # (h, w) which leaf a pixel belongs to, numbered so that every node is a range of them
    first: Count  # (n,) of that range
    last: Count  # (n,) one past it
    parent: Count  # (n,) the region that it was merged into, the root itself
    area: Count  # (n,) px
    box: Count  # (n, 4) first and one-past-last column and row: x0, y0, x1, y1
    contrast: NDArray[np.float64]  # (n,) 0..1: 1 - the cost of making the node by that of making its parent of it

    def ancestors(self, node: int) -> Count:
        """The node and all regions around it, the smallest first."""
        found = [node]
        while self.parent[node] != node:
            node = int(self.parent[node])
            found.append(node)
        return np.array(found, np.int64)

    @cached_property
    def leaf(self) -> Count:
        """(leaves,) the leaf of each rank."""
        return np.argsort(self.first[: (len(self.parent) + 1) // 2], kind="stable")

    def bits(self, node: int, part: tuple[slice, slice]) -> NDArray[np.bool_]:
        """Which pixels of a part of the image belong to a node."""
        rank = self.rank[part]
        return np.asarray((rank >= self.first[node]) & (rank < self.last[node]))


def partition_tree(rgb: NDArray[np.uint8], smoothing: float, noise: float) -> PartitionTree:
    """The tree of an image (h, w, 3).

    Its gradient is taken under a Gaussian of `smoothing` px; below `noise` (CIELAB per px) it counts as none.
    """
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    labels = _basins(cv2.GaussianBlur(lab, (0, 0), smoothing), noise)
    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count).astype(float)
    mean = np.stack([np.bincount(labels.ravel(), lab[..., c].ravel(), count) for c in range(3)], 1) / area[:, None]
    children, parent, cost = _merge(area, mean, _neighbours(labels))
    first, last = _ranges(children, count)
    return PartitionTree(
        rank=first[:count][labels],
        first=first,
        last=last,
        parent=parent,
        area=_summed(area, children).astype(np.int64),
        box=_boxes(labels, children),
        contrast=1 - cost / np.maximum(cost[parent], 1e-12),
    )


def _basins(lab: NDArray[np.float32], noise: float) -> Count:
    """(h, w) the catchment basins of the colour gradient, 0, 1, ..."""
    dx, dy = (cv2.Sobel(lab, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    gradient = np.maximum(np.sqrt((dx**2 + dy**2).sum(2)) - noise, 0)
    levels = np.round(gradient * (LEVELS / max(float(gradient.max()), 1e-6))).astype(np.uint16)
    lowest = levels == ndimage.minimum_filter(levels, NEAREST)
    markers, _ = ndimage.label(lowest)
    return np.asarray(ndimage.watershed_ift(levels, markers.astype(np.int32)), np.int64) - 1


def _neighbours(labels: Count) -> Count:
    """(e, 2) pairs of labels that share an edge of a pixel, each once, sorted."""
    across = np.c_[labels[:, :-1].ravel(), labels[:, 1:].ravel()]
    down = np.c_[labels[:-1].ravel(), labels[1:].ravel()]
    pairs = np.sort(np.concatenate([across, down]), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _merge(
    area: NDArray[np.float64], mean: NDArray[np.float64], pairs: Count
) -> tuple[Count, Count, NDArray[np.float64]]:
    """Children (n - leaves, 2) of the merged nodes, parents (n,), and the cost (n,) of making each, never falling."""
    leaves = len(area)
    areas, means = list(area), [tuple(m) for m in mean]
    near: list[set[int]] = [set() for _ in range(leaves)]
    for a, b in pairs.tolist():
        near[a].add(b)
        near[b].add(a)

    def price(a: int, b: int) -> float:
        (l1, a1, b1), (l2, a2, b2) = means[a], means[b]
        return areas[a] * areas[b] / (areas[a] + areas[b]) * ((l1 - l2) ** 2 + (a1 - a2) ** 2 + (b1 - b2) ** 2)

    heap = [(price(a, b), a, b) for a, b in pairs.tolist()]
    heapq.heapify(heap)
    alive = [True] * leaves
    children: list[tuple[int, int]] = []
    parent = list(range(2 * leaves - 1))
    cost = [0.0] * leaves
    while heap:
        paid, a, b = heapq.heappop(heap)
        if not (alive[a] and alive[b]):
            continue
        new, total = len(areas), areas[a] + areas[b]
        means.append(tuple((areas[a] * p + areas[b] * q) / total for p, q in zip(means[a], means[b], strict=True)))
        areas.append(total)
        alive[a] = alive[b] = False
        alive.append(True)
        around = (near[a] | near[b]) - {a, b}
        near.append(around)
        for other in sorted(around):
            near[other] -= {a, b}
            near[other].add(new)
            heapq.heappush(heap, (price(other, new), other, new))
        children.append((a, b))
        parent[a] = parent[b] = new
        cost.append(max(paid, cost[a], cost[b]))
    return np.array(children, np.int64).reshape(-1, 2), np.array(parent, np.int64), np.array(cost)


def _ranges(children: Count, leaves: int) -> tuple[Count, Count]:
    """The first and one-past-last rank of the leaves under each node, where siblings follow each other."""
    count = np.concatenate([np.ones(leaves, np.int64), np.zeros(len(children), np.int64)])
    for k, (a, b) in enumerate(children):
        count[leaves + k] = count[a] + count[b]
    first = np.zeros(len(count), np.int64)
    for k in range(len(children) - 1, -1, -1):
        a, b = children[k]
        first[a] = first[leaves + k]
        first[b] = first[a] + count[a]
    return first, first + count


def _summed(values: NDArray[np.float64], children: Count) -> NDArray[np.float64]:
    whole = list(values)
    for a, b in children:
        whole.append(whole[a] + whole[b])
    return np.array(whole)


def _boxes(labels: Count, children: Count) -> Count:
    """(n, 4) the boxes of all nodes."""
    found = ndimage.find_objects(labels + 1)
    boxes = [(x.start, y.start, x.stop, y.stop) for y, x in found]
    for a, b in children:
        (p0, q0, p1, q1), (r0, s0, r1, s1) = boxes[a], boxes[b]
        boxes.append((min(p0, r0), min(q0, s0), max(p1, r1), max(q1, s1)))
    return np.array(boxes, np.int64)
