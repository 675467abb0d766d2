"""Learned detectors: XFeat (Potje et al., CVPR 2024), DISK (Tyszkiewicz et al., NeurIPS 2020), ALIKED (Zhao et al.,
IEEE TIM 2023) and SuperPoint (DeTone et al., CVPRW 2018) behind one class, with the settings LightGlue was trained for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import torch
from kornia.feature import ALIKED, DISK

from zpm2 import weights
from zpm2.features import superpoint
from zpm2.features import xfeat as xfeat_network
from zpm2.features.frame import Frame, frame
from zpm2.features.protocol import Features
from zpm2.model import Image

# (b, 3, h, w) RGB 0..1 -> of each image (n, 2) px with pixel centres at 0, (n, d) unit descriptors, (n,) scores
Extract = Callable[[torch.Tensor], list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]]
BATCH = 16  # crops at a time


@dataclass(frozen=True, eq=False)
class NetworkDetector:
    """A network as a detector: see `frame` for what it is given, and for the way back to original px."""

    extract: Extract
    max_size: int  # px, longer side
    device: str

    def detect(self, images: Sequence[Image]) -> list[Features]:
        found: list[Features] = []
        for start in range(0, len(images), BATCH):
            shots = [frame(image, self.max_size, self.device) for image in images[start : start + BATCH]]
            for _, alike in groupby(shots, lambda shot: shot.pixels.shape):
                found += self._detect(list(alike))
        return found

    def _detect(self, shots: list[Frame]) -> list[Features]:
        """Of frames of one size."""
        with torch.inference_mode():
            found = self.extract(torch.cat([shot.pixels for shot in shots]))
            return [self._features(shot, *of) for shot, of in zip(shots, found, strict=True)]

    @staticmethod
    def _features(shot: Frame, points: torch.Tensor, descriptors: torch.Tensor, scores: torch.Tensor) -> Features:
        keep = shot.is_useful(points)
        return Features(
            shot.to_image(points[keep]),
            np.ascontiguousarray(descriptors[keep].float().cpu().numpy()),
            scores[keep].double().cpu().numpy(),
            shot.size,
        )


def xfeat(limit: int, device: str, progress: weights.Progress | None) -> Extract:
    """XFeat's sparse head, see `zpm2.features.xfeat`; 64 values each."""
    network = xfeat_network.load(device, progress)
    return lambda pixels: xfeat_network.extract(network, pixels, limit)


def disk(limit: int, device: str, progress: weights.Progress | None) -> Extract:
    """DISK trained with depth: maxima of 5 x 5 px, 128 values each."""
    network = DISK()
    network.load_state_dict(weights.load_state_dict("disk", progress=progress), strict=True)
    network.eval().to(device)

    def extract(pixels: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        return [(f.keypoints, f.descriptors, f.detection_scores) for f in network(pixels, n=limit)]

    return extract


def aliked(model: str, limit: int, device: str, progress: weights.Progress | None) -> Extract:
    """ALIKED "n16", "n16rot" or "n32": maxima of 5 x 5 px to sub-pixel, 128 values each.

    The threshold on the score is 0.05. The published 0.2 gives 0.6 times the matches, no more exact; none at all gives
    twice as many for three times the time of LightGlue.
    """
    network = ALIKED(f"aliked-{model}", max_num_keypoints=limit, detection_threshold=0.05)
    state = weights.load_state_dict(f"aliked_{model}", progress=progress)
    state["dkd.hw_grid"] = network.dkd.hw_grid  # computed, not learned
    network.load_state_dict(state, strict=True)
    network.eval().to(device)

    def extract(pixels: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        return [(f.keypoints, f.descriptors, f.keypoint_scores) for f in network(pixels)]

    return extract


def superpoint_v1(limit: int, device: str, progress: weights.Progress | None) -> Extract:
    """SuperPoint as published, on luma; 256 values each."""
    network = superpoint.SuperPoint()
    network.load_state_dict(weights.load_state_dict("superpoint", progress=progress), strict=True)
    network.eval().to(device)
    luma = torch.tensor([0.299, 0.587, 0.114], device=device).view(1, 3, 1, 1)

    def extract(pixels: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        return superpoint.extract(network, (pixels * luma).sum(1, keepdim=True), limit)

    return extract
