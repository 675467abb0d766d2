"""DISK (Tyszkiewicz et al., NeurIPS 2020), trained with depth, and LightGlue."""

from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo

if TYPE_CHECKING:
    import torch


@point_matcher(
    "disk",
    ModelInfo(
        task="points with a detector, LightGlue",
        code_licence="Apache-2.0",
        training_data="MegaDepth",
        weights=("disk", "disk_lightglue"),
        input_size="1024 px, longer side",
        bytes_per_pixel=2600.0,
    ),
)
def disk(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """Maxima of 5 x 5 px, 128 values each, with the settings that LightGlue was trained for."""
    from kornia.feature import DISK

    from zpm2.features.network_detector import with_lightglue

    network = DISK()
    network.load_state_dict(weights.load_state_dict("disk", progress=progress), strict=True)
    network.eval().to(device)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return [(f.keypoints, f.descriptors, f.detection_scores) for f in network(pixels, n=config.max_keypoints)]

    return with_lightglue("disk", extract, "disk_lightglue", config, device, progress)
