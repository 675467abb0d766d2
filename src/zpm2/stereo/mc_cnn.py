"""Disparity of a rectified pair by a learned matching cost.

Zbontar and LeCun, Stereo matching by training a convolutional neural network to compare image patches, JMLR 2016: the
"fast" network, written from the publication, and semi-global matching of its costs with prices that depend on the edges
of the image (here of one image, in the paper of both).
"""

from itertools import pairwise

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from zpm2 import memory, weights
from zpm2.config import StereoConfig
from zpm2.errors import InputError, WeightsError
from zpm2.model import Image
from zpm2.stereo.cost_volume import MAX_COSTS, Floats, cheapest, costs, require_libsgm
from zpm2.stereo.refine import Disparity, refined, refuse_far

RADIUS = 5  # px of the image around a pixel that its features depend on
# Bytes of a process that matches, measured and rounded up: to start with; for each cost of a strip, before and after
# its aggregation; for each pixel of a strip (features of both images and of the layers below them, prices); for each
# pixel of the pair
BASE, COST, STRIP_PIXEL, PIXEL = 0.6e9, 8.0, 2000.0, 100.0


class Network(nn.Module):
    """Five convolutions of 3 x 3 with 64 features. The layer names are those of the weights files."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(1, 64, 3)]
        for _ in range(RADIUS - 1):
            layers += [nn.ReLU(), nn.Conv2d(64, 64, 3)]
        self.conv_blocks = nn.Sequential(*layers)

    def forward(self, grey: torch.Tensor) -> torch.Tensor:
        """(h + 2 RADIUS, w + 2 RADIUS), standardised -> (64, h, w), unit vectors."""
        return F.normalize(self.conv_blocks(grey[None, None])[0], dim=0)


class McCnn:
    """A `StereoMatcher`. Photographs with more costs than `stereo.strip_costs` are matched in overlapping strips of
    rows: results depend on that number, and not on the memory that is free."""

    def __init__(self, config: StereoConfig, device: str) -> None:
        require_libsgm()
        self.config, self.device = config, device
        self.network = load(f"mccnn_{config.weights}").to(device)

    def __call__(self, left: Image, right: Image, low: int, high: int) -> Disparity:
        refuse_far(low, high)
        height, width = left.rgb.shape[:2]
        parts = strips(height, width * (high - low + 1), self.config)
        _refuse_large(max(last - first for first, last, _ in parts), height, width, high - low + 1)
        maps = [np.empty((height, width), np.float32) for _ in (left, right)]
        greys = [standardised(image) for image in (left, right)]
        with torch.inference_mode():
            for first, last, kept in parts:
                inner = slice(kept.start - first, kept.stop - first)
                a, b = (self._features(*of, first, last) for of in zip(greys, (left, right), strict=True))
                ahead, mirrored = greys[0][first:last], np.ascontiguousarray(greys[1][first:last, ::-1])
                maps[0][kept] = cheapest(costs(a, b, low, high), high, ahead, self.config)[inner]
                a, b = b.flip(2), a.flip(2)
                maps[1][kept] = cheapest(costs(a, b, low, high), high, mirrored, self.config)[inner, ::-1]
        return refined(maps, (left, right), low, self.config)

    def _features(self, grey: Floats, image: Image, first: int, last: int) -> torch.Tensor:
        """(64, last - first, w), 0 where there is no data."""
        rows = np.clip(np.arange(first - RADIUS, last + RADIUS), 0, len(grey) - 1)
        part = np.pad(grey[rows], ((0, 0), (RADIUS, RADIUS)), mode="edge")
        found: torch.Tensor = self.network(torch.from_numpy(part).to(self.device))
        if image.valid is not None:
            found *= torch.from_numpy(image.valid[first:last]).to(self.device)
        return found


def load(name: str) -> Network:
    """The network with the weights of that name. `WeightsError` where they are those of another network."""
    network = Network()
    try:
        network.load_state_dict(weights.load_state_dict(name), strict=True)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:200]
        raise WeightsError(f"{weights.entry(name).file} holds no weights of MC-CNN fast: {reason}") from error
    return network.eval()


def standardised(image: Image) -> Floats:
    """(h, w) grey values with mean 0 and standard deviation 1; 0 where there is no data."""
    grey = cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    known = grey if image.valid is None else grey[image.valid]
    if not known.size:
        return np.zeros_like(grey)
    mean, deviation = known.mean(dtype=np.float64), known.std(dtype=np.float64)
    grey = (grey - np.float32(mean)) / np.float32(deviation or 1.0)
    return grey if image.valid is None else np.where(image.valid, grey, np.float32(0))


def strips(height: int, costs_of_a_row: int, config: StereoConfig) -> list[tuple[int, int, slice]]:
    """First and last row (exclusive) of each strip, and those of its rows that count."""
    most = max(config.strip_costs // costs_of_a_row, 4 * config.strip_overlap, 1)
    if height <= most:
        return [(0, height, slice(0, height))]
    count = -(-height // (most - 2 * config.strip_overlap))
    edges = [height * k // count for k in range(count + 1)]
    return [
        (max(0, a - config.strip_overlap), min(height, b + config.strip_overlap), slice(a, b))
        for a, b in pairwise(edges)
    ]


def _refuse_large(rows: int, height: int, width: int, count: int) -> None:
    what = f"comparing {rows} rows of {width} px at {count} disparities by mc-cnn"
    ways = "reduce the photographs, set stereo.method=sgbm"
    if rows * width * count > MAX_COSTS:
        raise InputError(f"{what} has more than {MAX_COSTS} costs: make stereo.strip_overlap smaller, {ways}")
    needed = BASE + COST * rows * width * count + STRIP_PIXEL * rows * width + PIXEL * height * width
    memory.refuse_above(needed, what, f"make stereo.strip_costs smaller, {ways}, or raise --max-memory")
