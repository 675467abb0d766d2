"""Disparity of a rectified pair by a learned matching cost.

Zbontar and LeCun, Stereo matching by training a convolutional neural network to compare image patches, JMLR 2016, the
"fast" network, written from the publication. Costs are aggregated by semi-global matching (Hirschmueller, PAMI 2008), as
libSGM has it: on one core, so the same bytes each time.
"""

from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import nn

from zpm2 import memory, weights
from zpm2.config import StereoConfig
from zpm2.errors import MissingDependency, WeightsError
from zpm2.model import Image
from zpm2.stereo.refine import Disparity, refined

RADIUS = 5  # px of the image around a pixel that its features depend on
BLOCK = 128  # px of a row whose features are compared at once
# (row, column) of the paths, in the order that libSGM wants
PATHS = np.array([[0, 1], [1, 0], [1, 1], [1, -1], [0, -1], [-1, 0], [-1, -1], [-1, 1]], np.int32)
Grey = NDArray[np.float32]


class Network(nn.Module):
    """Five convolutions of 3 x 3, 64 features. The layer names are those of the weights files."""

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
    """A `StereoMatcher`. Photographs with more costs than `stereo.strip_costs` are matched in strips of rows that
    overlap; the results depend on that number, and not on the memory that there is."""

    def __init__(self, config: StereoConfig, device: str) -> None:
        try:
            from c_libsgm import sgm_api
        except ImportError as error:
            raise MissingDependency('stereo.method mc-cnn needs libsgm: pip install "zpm2[stereo]"') from error
        self.config, self.device, self._aggregate = config, device, sgm_api
        self.network = load(f"mccnn_{config.weights}").to(device)

    def __call__(self, left: Image, right: Image, low: int, high: int) -> Disparity:
        height, width = left.rgb.shape[:2]
        self._require_memory(height, width, high - low + 1)
        greys = [standardised(left), standardised(right)]
        maps = [np.empty((height, width), np.float32) for _ in greys]
        for first, last, keep in strips(height, width * (high - low + 1), self.config):
            sides = [self._features(grey, image, first, last) for grey, image in zip(greys, (left, right), strict=True)]
            inner = slice(keep.start - first, keep.stop - first)
            maps[0][keep] = self._searched(sides[0], sides[1], low, high)[inner]
            mirrored = self._searched(sides[1].flip(2), sides[0].flip(2), low, high)[inner]
            maps[1][keep] = mirrored[:, ::-1]
        return refined(maps, (left, right), low, self.config)

    def _features(self, grey: Grey, image: Image, first: int, last: int) -> torch.Tensor:
        """(64, rows, w) of rows `first` to `last`, 0 where there is no data."""
        rows = np.clip(np.arange(first - RADIUS, last + RADIUS), 0, len(grey) - 1)
        part = np.pad(grey[rows], ((0, 0), (RADIUS, RADIUS)), mode="edge")
        with torch.inference_mode():
            found = self.network(torch.from_numpy(part).to(self.device))
            if image.valid is not None:
                found *= torch.from_numpy(image.valid[first:last]).to(self.device)
        return found

    def _searched(self, left: torch.Tensor, right: torch.Tensor, low: int, high: int) -> Disparity:
        """(rows, w) px of the left side."""
        volume = costs(left, right, low, high)
        rows, width, _ = volume.shape
        steps = [np.full((rows, width, len(PATHS)), price, np.float32) for price in self.config.cost_steps]
        same = np.ones((rows, width), np.float32)
        return best(self._aggregate(volume, *steps, PATHS, np.float32(np.inf), same)["cv"], high)

    def _require_memory(self, height: int, width: int, count: int) -> None:
        rows = max(last - first for first, last, _ in strips(height, width * count, self.config))
        memory.refuse_above(
            BASE_BYTES + COST_BYTES * rows * width * count + ROW_BYTES * rows * width + PIXEL_BYTES * height * width,
            f"comparing {rows} rows of {width} px at {count} disparities by mc-cnn",
            "make stereo.strip_costs smaller, or reduce the photographs, or set stereo.method=sgbm, or raise --max-memory",
        )


# Bytes of a process that matches, rounded up: to start with, for each cost of a strip (before and after aggregation),
# for each pixel of a strip (features of both images, of the layers below them, and prices), of each pixel of the pair
BASE_BYTES, COST_BYTES, ROW_BYTES, PIXEL_BYTES = 0.6e9, 8.0, 1500.0, 60.0


def load(name: str) -> Network:
    """The network with the weights of that name. `WeightsError` where they are not those of this network."""
    network = Network()
    try:
        network.load_state_dict(weights.load_state_dict(name), strict=True)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:200]
        raise WeightsError(f"{weights.entry(name).file} holds no weights of MC-CNN fast: {reason}") from error
    return network.eval()


def standardised(image: Image) -> Grey:
    """(h, w) grey values with mean 0 and standard deviation 1; 0 where there is no data."""
    grey = cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    known: Any = grey if image.valid is None else grey[image.valid]
    if not known.size:
        return np.zeros_like(grey)
    grey = (grey - known.mean(dtype=np.float64)).astype(np.float32) / np.float32(known.std(dtype=np.float64) or 1.0)
    return grey if image.valid is None else np.where(image.valid, grey, np.float32(0))


def strips(height: int, costs_of_a_row: int, config: StereoConfig) -> list[tuple[int, int, slice]]:
    """First and last row (exclusive) of each strip, and those of its rows that count."""
    most = max(config.strip_costs // costs_of_a_row, 4 * config.strip_overlap)
    if height <= most:
        return [(0, height, slice(0, height))]
    count = -(-height // (most - 2 * config.strip_overlap))
    edges = [height * k // count for k in range(count + 1)]
    return [
        (max(0, a - config.strip_overlap), min(height, b + config.strip_overlap), slice(a, b))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]


def costs(left: torch.Tensor, right: torch.Tensor, low: int, high: int) -> NDArray[np.float32]:
    """(h, w, count) of (64, h, w) features: -cosine at the disparities from `high` down to `low`; 0 without a partner.

    In blocks of a row: all products of `BLOCK` pixels with the columns that they may meet, of which a band counts.
    """
    _, height, width = left.shape
    count, blocks = high - low + 1, -(-width // BLOCK)
    reach = BLOCK + count - 1  # columns that a block may meet, of which pixel i at disparity high - k meets i + k
    a = F.pad(left.permute(1, 2, 0), (0, 0, 0, blocks * BLOCK - width)).unflatten(1, (blocks, BLOCK))
    b = F.pad(right.permute(1, 0, 2), (max(0, high), max(0, blocks * BLOCK - width - low)))
    b = b[..., max(0, -high) :][..., : blocks * BLOCK + count - 1]
    result = np.empty((height, width, count), np.float32)
    with torch.inference_mode():
        for y in range(height):
            products = a[y] @ b[y].unfold(1, reach, BLOCK).transpose(0, 1)
            band = products.as_strided((blocks, BLOCK, count), (BLOCK * reach, reach + 1, 1))
            result[y] = -band.reshape(-1, count)[:width].cpu().numpy()
    return result


def best(volume: NDArray[np.float32], high: int) -> Disparity:
    """(h, w) px of the least of (h, w, count) costs, which are of disparities from `high` down; between whole pixels by
    the parabola through it and its neighbours."""
    index = volume.argmin(2)
    inner = np.clip(index, 1, max(1, volume.shape[2] - 2))
    if volume.shape[2] < 3:
        return (high - index).astype(np.float32)
    before, there, after = (np.take_along_axis(volume, (inner + k)[..., None], 2)[..., 0] for k in (-1, 0, 1))
    bend = before - 2 * there + after
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where((inner == index) & (bend > 0), (before - after) / (2 * bend), 0)
    return (high - index - shift).astype(np.float32)
