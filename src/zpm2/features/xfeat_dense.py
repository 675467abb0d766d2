"""XFeat semi-dense (XFeat*, Potje et al., CVPR 2024): no detector, whole cells are matched and then refined.

Written around kornia's backbone rather than its `match_xfeat_star`, which gives no scores and, as the original does,
moves only the left point, which leaves it about one pixel up and to the left of where it belongs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features import xfeat_network
from zpm2.features.frame import frame
from zpm2.features.xfeat_network import CELL
from zpm2.model import Image, PointMatches

ZOOMS = ((0.6, 0.2), (1.3, 0.8))  # sizes of the image, each with its share of the cells, as published
MIN_CONFIDENCE = 0.25  # of the refinement, as published
TEMPERATURE = 3.0  # of the refinement's soft-argmax, as published
ROWS_AT_ONCE = 1024  # of the similarity matrix, to bound the memory


@dataclass(frozen=True, eq=False)
class _Cells:
    corners: NDArray[np.float64]  # (n, 2) px of the original image, top-left corner
    pixel: NDArray[np.float64]  # (n, 2) original px per network px
    descriptors: torch.Tensor  # (n, 64)


class XFeatDense:
    """Mutual nearest cells of two images at two sizes, refined to sub-pixel on both sides.

    The refinement network places the left point in its cell for a given right cell. It runs both ways and each point
    moves half of the way, so that its systematic errors cancel. The score is the lower of the two confidences (0..1, at
    least `MIN_CONFIDENCE`).
    """

    name = "xfeat-dense"

    def __init__(self, config: PointsConfig, device: str, progress: weights.Progress | None = None) -> None:
        self.config, self.device = config, device
        self.network = xfeat_network.load(device, progress)

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`."""
        with torch.inference_mode():
            a, b = self._cells(left), self._cells(right)
            if not len(a.corners) or not len(b.corners):
                return PointMatches.empty()
            to_right, to_left = _nearest(a.descriptors, b.descriptors), _nearest(b.descriptors, a.descriptors)
            i = torch.nonzero(to_left[to_right] == torch.arange(len(to_right), device=to_right.device))[:, 0]
            j = to_right[i]
            move_a, confidence_a = self._refine(a.descriptors[i], b.descriptors[j])
            move_b, confidence_b = self._refine(b.descriptors[j], a.descriptors[i])
        rows_a, rows_b = i.cpu().numpy(), j.cpu().numpy()
        points_a = a.corners[rows_a] + move_a / 2 * a.pixel[rows_a]
        points_b = b.corners[rows_b] + move_b / 2 * b.pixel[rows_b]
        score = np.minimum(confidence_a, confidence_b)
        good = (score >= MIN_CONFIDENCE) & _within(points_a, left) & _within(points_b, right)
        return PointMatches(points_a, points_b, score)[good]

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`."""
        return [self.match(left, right) for left, right in pairs]

    def _cells(self, image: Image) -> _Cells:
        """The most reliable useful cells of the image at each of `ZOOMS`."""
        corners, pixel, descriptors = [], [], []
        for zoom, share in ZOOMS:
            seen = frame(image, self.config, self.device, zoom)
            maps, _, reliability = self.network(seen.pixels)
            useful = F.max_pool2d(seen.useful[None].float(), CELL)[0] > 0
            cells = torch.nonzero(useful.flatten())[:, 0]
            order = torch.argsort(reliability.flatten()[cells], descending=True, stable=True)
            best = cells[order[: int(share * self.config.max_keypoints)]]
            columns = useful.shape[1]
            at = torch.stack([best % columns, best // columns], 1).cpu().numpy() * float(CELL)
            corners.append(at / seen.scale)
            pixel.append(np.broadcast_to(1.0 / seen.scale, at.shape))
            descriptors.append(maps[0].flatten(1).T[best])
        return _Cells(np.concatenate(corners), np.concatenate(pixel), torch.cat(descriptors))

    def _refine(self, here: torch.Tensor, there: torch.Tensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n, 2) network px from the cell's corner to the point, -4..3, and the (n,) confidence in it."""
        weight = (self.network.fine_matcher(torch.cat([here, there], 1)) * TEMPERATURE).softmax(1)
        steps = torch.arange(CELL, device=weight.device, dtype=weight.dtype) - CELL // 2
        grid = weight.view(-1, CELL, CELL)  # rows y, columns x
        move = torch.stack([grid.sum(1) @ steps, grid.sum(2) @ steps], 1)
        return move.double().cpu().numpy(), weight.amax(1).double().cpu().numpy()


def _nearest(query: torch.Tensor, base: torch.Tensor) -> torch.Tensor:
    """(n,) row of `base` with the largest dot product to each row of `query`."""
    return torch.cat([(rows @ base.T).argmax(1) for rows in torch.split(query, ROWS_AT_ONCE)])


def _within(points: NDArray[np.float64], image: Image) -> NDArray[np.bool_]:
    return np.asarray(((points >= 0) & (points <= [image.width, image.height])).all(1))
