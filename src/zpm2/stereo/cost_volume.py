"""Costs of all disparities from features of each pixel, and the disparities of least cost by semi-global matching.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 2008, as libSGM has it. It works on
one core, in one order: the same costs give the same bytes.
"""

from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from zpm2.config import StereoConfig
from zpm2.errors import MissingDependency
from zpm2.stereo.refine import Disparity

Floats = NDArray[np.float32]
BLOCK = 128  # px of a row whose features are compared at once
MAX_COSTS = 2**31 - 1  # libSGM counts them in 32 bits
# (row, column) steps of the paths, in libSGM's order
PATHS = np.array([[0, 1], [1, 0], [1, 1], [1, -1], [0, -1], [-1, 0], [-1, -1], [-1, 1]], np.int32)


def require_libsgm() -> Callable[..., dict[str, Floats]]:
    """The function of libSGM; `MissingDependency` without it."""
    try:
        from c_libsgm import sgm_api
    except ImportError as error:
        raise MissingDependency('stereo.method=mc-cnn needs libsgm: pip install "zpm2[stereo]"') from error
    found: Callable[..., dict[str, Floats]] = sgm_api
    return found


def costs(left: torch.Tensor, right: torch.Tensor, low: int, high: int) -> Floats:
    """(h, w, count) of (f, h, w) features: minus their products at the disparities from `high` down to `low`; 0 where
    the right image has no such column."""
    _, height, width = left.shape
    count, blocks = high - low + 1, -(-width // BLOCK)
    # Pixel i of a block meets its columns i to i + count - 1. All products of a block are made, and that band taken.
    reach = BLOCK + count - 1
    a = F.pad(left.permute(1, 2, 0), (0, 0, 0, blocks * BLOCK - width)).reshape(height, blocks, BLOCK, -1)
    b = F.pad(right.permute(1, 0, 2), (max(0, high), max(0, blocks * BLOCK - width - low)))
    b = b[..., max(0, -high) :][..., : blocks * BLOCK + count - 1]
    result = np.empty((height, width, count), np.float32)
    for y in range(height):
        products = a[y] @ b[y].unfold(1, reach, BLOCK).transpose(0, 1)
        band = products.as_strided((blocks, BLOCK, count), (BLOCK * reach, reach + 1, 1))
        result[y] = -band.reshape(-1, count)[:width].cpu().numpy()
    return result


def cheapest(volume: Floats, high: int, grey: Floats, config: StereoConfig) -> Disparity:
    """(h, w) px of the least aggregated cost, from `costs` and (h, w) standardised grey values of the left image."""
    steps = _prices(grey, config)
    one_segment = np.ones(grey.shape, np.float32)
    return least(require_libsgm()(volume, *steps, PATHS, np.inf, one_segment)["cv"], high)


def _prices(grey: Floats, config: StereoConfig) -> tuple[Floats, Floats]:
    """(h, w, paths) P1 and P2, reduced where the image has an edge on the way. What wraps around does not count: paths
    begin at the border."""
    edge = [np.abs(grey - np.roll(grey, step, (0, 1))) >= config.edge for step in PATHS]
    part = np.where(np.stack(edge, -1), np.float32(1 / config.edge_discount), np.float32(1))
    return np.float32(config.small_cost) * part, np.float32(config.large_cost) * part


def least(volume: Floats, high: int) -> Disparity:
    """(h, w) px where (h, w, count) costs, of disparities from `high` down, are least; between whole pixels by the
    parabola through the least cost and its neighbours."""
    index = volume.argmin(2)
    inside = (index > 0) & (index < volume.shape[2] - 1)
    at = np.where(inside, index, 0)[..., None]
    before, there, after = (
        np.take_along_axis(volume, np.clip(at + k, 0, volume.shape[2] - 1), 2)[..., 0] for k in (-1, 0, 1)
    )
    bend = before - 2 * there + after
    shift = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=inside & (bend > 0))
    return (high - index - shift).astype(np.float32)
