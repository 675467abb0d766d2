"""SuperPoint (DeTone, Malisiewicz and Rabinovich, CVPR Workshops 2018), written from the publication.

The layer names are those of the published weights file, which has a licence of its own that forbids commercial use.
"""

import torch
import torch.nn.functional as F
from torch import nn

CELL = 8  # px, stride of both heads
NMS_RADIUS = 4  # px, of the non-maximum suppression, and width of the border without points, as published


class SuperPoint(nn.Module):
    """A VGG-like encoder with a point head (64 positions of a cell and "none") and a descriptor head (256)."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1a, self.conv1b = _conv(1, 64), _conv(64, 64)
        self.conv2a, self.conv2b = _conv(64, 64), _conv(64, 64)
        self.conv3a, self.conv3b = _conv(64, 128), _conv(128, 128)
        self.conv4a, self.conv4b = _conv(128, 128), _conv(128, 128)
        self.convPa, self.convPb = _conv(128, 256), nn.Conv2d(256, CELL * CELL + 1, 1)
        self.convDa, self.convDb = _conv(128, 256), nn.Conv2d(256, 256, 1)

    def forward(self, gray: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(b, 1, h, w) 0..1, sides multiples of 8 -> (b, h, w) probability, (b, 256, h / 8, w / 8) descriptors."""
        x = F.relu(self.conv1b(F.relu(self.conv1a(gray))))
        x = F.relu(self.conv2b(F.relu(self.conv2a(F.max_pool2d(x, 2)))))
        x = F.relu(self.conv3b(F.relu(self.conv3a(F.max_pool2d(x, 2)))))
        x = F.relu(self.conv4b(F.relu(self.conv4a(F.max_pool2d(x, 2)))))
        cells = self.convPb(F.relu(self.convPa(x))).softmax(1)[:, :-1]
        descriptors = F.normalize(self.convDb(F.relu(self.convDa(x))), dim=1)
        return F.pixel_shuffle(cells, CELL)[:, 0], descriptors


def extract(
    network: SuperPoint, gray: torch.Tensor, limit: int, threshold: float
) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
    """The `limit` best points of each of (b, 1, h, w) images: (n, 2) px, centres at 0; (n, 256) unit; (n,) probability.

    Points are maxima of their (2 NMS_RADIUS + 1)^2 window, above `threshold`. Descriptors are read bilinearly (the
    paper: bicubically) at the point itself, cell (j, i) being centred on pixel corner (8 i + 4, 8 j + 4).
    """
    return [_points(probability, maps, limit, threshold) for probability, maps in zip(*network(gray), strict=True)]


def _points(
    probability: torch.Tensor, descriptors: torch.Tensor, limit: int, threshold: float
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Of one image: (h, w) and (256, h / 8, w / 8)."""
    height, width = probability.shape
    peak = F.max_pool2d(probability[None], 2 * NMS_RADIUS + 1, stride=1, padding=NMS_RADIUS) == probability[None]
    y, x = torch.nonzero((peak & (probability > threshold))[0], as_tuple=True)
    inner = (x >= NMS_RADIUS) & (x < width - NMS_RADIUS) & (y >= NMS_RADIUS) & (y < height - NMS_RADIUS)
    y, x = y[inner], x[inner]
    scores, best = torch.sort(probability[y, x], descending=True, stable=True)
    points = torch.stack([x, y], 1)[best[:limit]].float()
    grid = (points + 0.5) / points.new_tensor([width, height]) * 2.0 - 1.0
    read = F.grid_sample(
        descriptors[None], grid[None, None], mode="bilinear", align_corners=False, padding_mode="border"
    )
    return points, F.normalize(read[0, :, 0].T, dim=1), scores[:limit]


def _conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)
