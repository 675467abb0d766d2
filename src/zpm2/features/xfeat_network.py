"""XFeat (Potje et al., CVPR 2024): loading the backbone, and its sparse points.

The backbone is kornia's. The points are read here, to sub-pixel precision; those of kornia and of the original are
whole pixels.
"""

import torch
import torch.nn.functional as F
from kornia.feature.xfeat import XFeatModel
from kornia.geometry.subpix import nms2d

from zpm2 import weights

CELL = 8  # px, stride of the backbone's maps
POINT_THRESHOLD = 0.05  # of the point probability, as published
NMS_WINDOW = 5  # px, side of the non-maximum suppression, as published


def load(device: str, progress: weights.Progress | None) -> XFeatModel:
    """The backbone with its weights, ready to run."""
    network = XFeatModel()
    network.load_state_dict(weights.load_state_dict("xfeat", progress=progress), strict=True)
    return network.eval().to(device)


def extract(
    network: XFeatModel, pixels: torch.Tensor, limit: int
) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
    """The `limit` best points of each of (b, 3, h, w) images: (n, 2) px, centres at 0; (n, 64) unit descriptors; (n,)
    scores.

    Points are the maxima of the probability, moved to its centre of mass over 3 x 3 px: on real stereo pairs this takes
    the matches within 1 px of the truth from a third to nearly a half. The score is probability times reliability.
    """
    each = (torch.split(maps, 1) for maps in network(pixels))
    return [_points(maps, logits, reliability, limit) for maps, logits, reliability in zip(*each, strict=True)]


def _points(
    maps: torch.Tensor, logits: torch.Tensor, reliability: torch.Tensor, limit: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Of one image: (1, 64, h / 8, w / 8), (1, 65, h / 8, w / 8), (1, 1, h / 8, w / 8)."""
    probability = F.pixel_shuffle(logits.softmax(1)[:, : CELL * CELL], CELL)
    peak = nms2d(probability, (NMS_WINDOW, NMS_WINDOW), mask_only=True) & (probability > POINT_THRESHOLD)
    y, x = torch.nonzero(peak[0, 0], as_tuple=True)
    corners = torch.stack([x, y], 1).float()
    scores = probability[0, 0, y, x] * _read(reliability, corners, "bilinear")[:, 0]
    scores, best = torch.sort(scores, descending=True, stable=True)
    best = best[:limit]
    points = corners[best] + _centre_of_mass(probability[0, 0], y[best], x[best])
    descriptors = _read(F.normalize(maps, dim=1), points, "bicubic")
    return points, F.normalize(descriptors, dim=1), scores[:limit]


def _read(maps: torch.Tensor, points: torch.Tensor, mode: str) -> torch.Tensor:
    """(n, c) values of (1, c, h / 8, w / 8) maps at (n, 2) px."""
    height, width = maps.shape[2:]
    grid = (points + 0.5) / CELL / points.new_tensor([width, height]) * 2.0 - 1.0
    return F.grid_sample(maps, grid[None, None], mode=mode, align_corners=False)[0, :, 0].T


def _centre_of_mass(probability: torch.Tensor, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """(n, 2) px from pixel (x, y) to the centre of mass of the 3 x 3 px around it, none of which leaves the image."""
    step = torch.arange(-1, 2, device=probability.device)
    mass = probability[y[:, None, None] + step[:, None], x[:, None, None] + step]
    total = mass.sum((1, 2))
    return torch.stack([(mass.sum(1) * step).sum(1), (mass.sum(2) * step).sum(1)], 1) / total[:, None]
