"""Efficient LoFTR (Wang et al., CVPR 2024): from its features to points.

The trained layers are those of `transformers`. How features become points holds no weights and is written here from
the publication, as `transformers` (seen with 5.24) pairs the best row of each column with the best column of each row,
which are two different matches, and takes one softmax over all matches instead of over a window.
"""

from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from transformers import EfficientLoFTRForKeypointMatching

CELL = 8  # px, side of a coarse cell, and of the window in which its point is placed
AROUND = CELL + 2  # px, side of the window of the right image: one px more on each side
REGRESSED = 8  # the last channels of a fine feature place the point within a pixel
REGRESSION_TEMPERATURE = 10.0  # as published
TEMPERATURE = 0.1  # of the coarse dual softmax, as published
BORDER = 2  # cells along the border of an image that take no part, as published
AT_ONCE = 2048  # matches that are refined at a time, to bound the memory


def match(
    network: "EfficientLoFTRForKeypointMatching", left: Tensor, right: Tensor, threshold: float
) -> list[tuple[Tensor, Tensor, Tensor]]:
    """The points of each of (b, 1, h, w) grey pairs 0..1, both sides multiples of 32: (n, 2) and (n, 2) px, pixel
    centres at +0.5; (n,) confidence, above `threshold`."""
    coarse, *finer = network.efficientloftr(torch.stack([left, right], 1)).feature_maps
    windows = network.refinement_layer(coarse / coarse.shape[2] ** 0.5, finer)
    columns = coarse.shape[-1]
    found = []
    for maps, of_left, of_right in zip(coarse, *windows, strict=True):
        i, j, confidence = coarse_matches(maps[0], maps[1], threshold)
        parts = [
            refine(of_left[rows], of_right[others])
            for rows, others in zip(torch.split(i, AT_ONCE), torch.split(j, AT_ONCE), strict=True)
        ]
        moves = [torch.cat(side) for side in zip(*parts, strict=True)]
        corners = [torch.stack([at % columns, at // columns], 1) * float(CELL) for at in (i, j)]
        found.append((corners[0] + moves[0], corners[1] + moves[1], confidence))
    return found


def coarse_matches(left: Tensor, right: Tensor, threshold: float) -> tuple[Tensor, Tensor, Tensor]:
    """(c, h, w) maps of two images -> (n,) cells of the left, (n,) cells of the right one, row by row, and (n,)
    confidence: cells that are each other's best, above `threshold`, and not at the border."""
    channels, height, width = left.shape
    similarity = (left.flatten(1).T / channels**0.5) @ (right.flatten(1) / channels**0.5) / TEMPERATURE
    confidence = similarity.softmax(0) * similarity.softmax(1)
    best, j = confidence.max(1)
    inner = torch.zeros(height, width, dtype=torch.bool, device=left.device)
    inner[BORDER : height - BORDER, BORDER : width - BORDER] = True
    inner = inner.flatten()
    i = torch.nonzero((best > threshold) & (confidence.amax(0)[j] == best) & inner & inner[j])[:, 0]
    return i, j[i], best[i]


def refine(left: Tensor, right: Tensor) -> tuple[Tensor, Tensor]:
    """(n, 64, c) and (n, 100, c) features of the pixels of windows -> (n, 2) and (n, 2) px from the coarse point.

    First the pair of pixels that fits best, then the place within the right pixel. As published, pixels count from -3.5
    to 3.5, and the second step looks at the 3 x 3 px one to the left and above: the network was trained with both.
    """
    (left, fine), (right, fine_right) = ((each[..., :-REGRESSED], each[..., -REGRESSED:]) for each in (left, right))
    channels = left.shape[2] + REGRESSED
    similarity = left @ right.mT / channels
    fits = (similarity.softmax(1) * similarity.softmax(2)).view(-1, CELL**2, AROUND, AROUND)[..., 1:-1, 1:-1]
    best = fits.flatten(1).argmax(1)
    a, b = best // CELL**2, best % CELL**2
    moves = [torch.stack([at % CELL, at // CELL], 1) - (CELL - 1) / 2 for at in (a, b)]
    step = torch.arange(-1, 2, device=left.device)
    n = torch.arange(len(left), device=left.device)
    within = (fine_right @ fine[n, a][..., None] / REGRESSED**0.5).view(-1, AROUND, AROUND)
    y, x = (b // CELL)[:, None, None] + step[:, None], (b % CELL)[:, None, None] + step
    around = within[n[:, None, None], y, x]
    heat = (around.flatten(1) / REGRESSION_TEMPERATURE).softmax(1).view(-1, 3, 3)
    return moves[0], moves[1] + torch.stack([heat.sum(1) @ step.to(heat), heat.sum(2) @ step.to(heat)], 1)
