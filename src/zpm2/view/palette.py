"""Colours for many items at once, so that neighbours look different."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

PALETTE_SIZE = 36
LIGHTNESS = (48.0, 70.0, 92.0)  # of CIELAB, far enough apart that any colour vision tells neighbours apart by them
COMPARE_ALL = 1000  # up to so many items, each is compared with all others; otherwise only with its neighbours
NEIGHBORS = 16  # neighbours of each class of size

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


def distinct_colors(centers: Array, reach: Array) -> list[tuple[int, int, int]]:
    """An RGB colour for each of n items, different from those of the items near it.

    centers: (n, d) places; reach: (n,) half of their size, in the same unit. Hues follow the golden angle at three
    lightnesses. Each item in turn takes the colour that differs most from those of its neighbours; near ones count
    most. With more than `COMPARE_ALL` items, large items come first; time grows with n log n.
    """
    hues = np.deg2rad(np.arange(PALETTE_SIZE) * 137.508)
    light = np.resize(LIGHTNESS, PALETTE_SIZE)
    wanted = np.stack([light, 75 * np.cos(hues), 75 * np.sin(hues)], axis=1).astype(np.float32)
    rgb = np.clip(cv2.cvtColor(wanted[None], cv2.COLOR_Lab2RGB), 0, 1)
    palette = np.rint(rgb[0] * 255).astype(int)
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab)[0]
    likeness = np.exp(-((lab[:, None] - lab[None]) ** 2).sum(2) / (2 * 30.0**2))
    count = len(centers)
    many = count > COMPARE_ALL
    order = np.argsort(-reach, kind="stable") if many else np.arange(count)
    centers, reach = centers[order], reach[order]
    earlier = _neighbors(centers) if many else [np.arange(k) for k in range(count)]
    taken, used = np.zeros(count, int), np.zeros(PALETTE_SIZE)
    for k, near in enumerate(earlier):
        distance = np.linalg.norm(centers[near] - centers[k], axis=1)
        nearness = 1 / (0.05 + distance / (reach[near] + reach[k] + 1e-300)) ** 4
        taken[k] = int(np.argmin(nearness @ likeness[taken[near]] + 1e-3 * used))
        used[taken[k]] += 1
    back = np.argsort(order, kind="stable")
    return [(int(r), int(g), int(b)) for r, g, b in palette[taken[back]]]


def _neighbors(centers: Array) -> list[Rows]:
    """For each of n items, largest first, the rows before it that its colour has to differ from, ascending.

    These are the nearest `NEIGHBORS` among all items, among the largest quarter, among the largest sixteenth, and so
    on: a large item may be near to many others although its centre is not.
    """
    count = len(centers)
    keys, size = [], count
    while size > NEIGHBORS:
        _, near = cKDTree(centers[:size]).query(centers, k=NEIGHBORS)
        rows, others = np.repeat(np.arange(count), NEIGHBORS), near.ravel()
        keys.append(np.maximum(rows, others) * count + np.minimum(rows, others))
        size //= 4
    later, before = np.divmod(np.unique(np.concatenate(keys)), count)
    later, before = later[later != before], before[later != before]
    return np.split(before, np.searchsorted(later, np.arange(1, count)))
