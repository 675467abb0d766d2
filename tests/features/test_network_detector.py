"""How many crops a network sees at a time."""

import numpy as np
import pytest
import torch

from zpm2.config import PointsConfig
from zpm2.features.network_detector import NetworkDetector
from zpm2.model import Image


@pytest.mark.parametrize(
    ("bytes_per_pixel", "batches"), [(0.0, [16, 4]), (140.0, [16, 4]), (4e4, [3, 3, 3, 3, 3, 1, 3, 1])]
)
def test_a_batch_is_bounded_by_its_memory(bytes_per_pixel: float, batches: list[int]) -> None:
    seen: list[int] = []

    def extract(pixels: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        seen.append(len(pixels))
        return [(pixels.new_full((1, 2), 30.0), each.mean().view(1, 1), pixels.new_ones(1)) for each in pixels]

    crops = [Image(np.full((64, 64, 3), shade, np.uint8)) for shade in range(20)]
    for crop in crops:
        crop.rgb[::2] += 9  # something to see
    found = NetworkDetector(extract, PointsConfig(), "cpu", bytes_per_pixel).detect(crops)
    assert seen == batches
    assert [round(float(each.descriptors[0, 0]) * 255 - 4.5) for each in found] == list(range(20))
