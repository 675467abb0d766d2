"""A learned detector behind the protocol of all detectors, and LightGlue as its second half."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import torch

from zpm2.config import PointsConfig
from zpm2.features.frame import Frame, frame
from zpm2.features.lightglue import LightGlueMatcher
from zpm2.features.protocol import Features, SparseMatcher
from zpm2.features.registry import METHODS
from zpm2.model import Image
from zpm2.weights import Progress

# (b, 3, h, w) RGB 0..1 -> of each image (n, 2) px with pixel centres at 0, (n, d) unit descriptors, (n,) scores
Extract = Callable[[torch.Tensor], list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]]
BATCH = 16  # crops that a network sees at a time, to bound the memory
BATCH_BYTES = 5e8  # and what they take, where that is known of the network (`ModelInfo.bytes_per_pixel`)


def with_lightglue(
    name: str, extract: Extract, weights: str, config: PointsConfig, device: str, progress: Progress | None
) -> SparseMatcher:
    """The matcher `name`: a network's points, paired by LightGlue with the `weights` of that name."""
    detector = NetworkDetector(extract, config, device, METHODS.get(name).info.bytes_per_pixel)
    return SparseMatcher(name, detector, LightGlueMatcher(weights, device, progress))


@dataclass(frozen=True, eq=False)
class NetworkDetector:
    """A network as a detector. `frame` makes its input, and takes its points back to original px."""

    extract: Extract
    config: PointsConfig
    device: str
    bytes_per_pixel: float = 0.0  # memory at its peak; 0: not known

    def detect(self, images: Sequence[Image]) -> list[Features]:
        """See `Detector.detect`."""
        found: list[Features] = []
        for start in range(0, len(images), BATCH):
            frames = [frame(image, self.config, self.device) for image in images[start : start + BATCH]]
            for _, same_size in groupby(frames, lambda each: each.pixels.shape):
                of_one_size = list(same_size)
                pixels = of_one_size[0].pixels[0, 0].numel()
                at_once = max(1, int(BATCH_BYTES / max(self.bytes_per_pixel * pixels, 1.0)))
                for first in range(0, len(of_one_size), at_once):
                    found += self._detect(of_one_size[first : first + at_once])
        return found

    def _detect(self, frames: list[Frame]) -> list[Features]:
        """Of frames of one size."""
        with torch.inference_mode():
            found = self.extract(torch.cat([each.pixels for each in frames]))
            return [self._features(each, *of) for each, of in zip(frames, found, strict=True)]

    @staticmethod
    def _features(seen: Frame, points: torch.Tensor, descriptors: torch.Tensor, scores: torch.Tensor) -> Features:
        keep = seen.is_useful(points)
        return Features(
            seen.to_image(points[keep]),
            np.ascontiguousarray(descriptors[keep].float().cpu().numpy()),
            scores[keep].double().cpu().numpy(),
            seen.size,
        )
