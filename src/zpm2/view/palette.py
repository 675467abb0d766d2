"""Colours for many things at once: neighbours never look alike."""

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = 36


def distinct_colors(centers: NDArray[np.float64], reach: NDArray[np.float64]) -> list[tuple[int, int, int]]:
    """An RGB colour for each of n things, unlike those of the things near it.

    centers: (n, d) where they are; reach: (n,) half of their size, in the same unit. Hues follow the golden angle at
    three lightnesses; one after the other takes the colour that is least like what its neighbours have, near ones
    counting most.
    """
    hues = np.deg2rad(np.arange(SIZE) * 137.508)
    light = np.resize([62.0, 76.0, 88.0], SIZE)
    wanted = np.stack([light, 75 * np.cos(hues), 75 * np.sin(hues)], axis=1).astype(np.float32)
    rgb = np.clip(cv2.cvtColor(wanted[None], cv2.COLOR_Lab2RGB), 0, 1)
    palette = np.rint(rgb[0] * 255).astype(int)
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab)[0]
    likeness = np.exp(-((lab[:, None] - lab[None]) ** 2).sum(2) / (2 * 30.0**2))
    taken = np.zeros(len(centers), int)
    for k in range(len(centers)):
        distance = np.linalg.norm(centers[:k] - centers[k], axis=1)
        nearness = 1 / (0.05 + distance / (reach[:k] + reach[k] + 1e-300)) ** 4
        taken[k] = int(np.argmin(nearness @ likeness[taken[:k]] + 1e-3 * np.bincount(taken[:k], minlength=SIZE)))
    return [(int(r), int(g), int(b)) for r, g, b in palette[taken]]
