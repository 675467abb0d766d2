"""SuperPoint (DeTone et al., CVPR Workshops 2018) and LightGlue."""

from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo

if TYPE_CHECKING:
    import torch

LUMA = (0.299, 0.587, 0.114)  # ITU-R BT.601: the network sees grey values


@point_matcher(
    "superpoint",
    ModelInfo(
        task="points with a detector, LightGlue",
        code_licence="Apache-2.0",
        training_data="synthetic shapes and COCO; LightGlue: MegaDepth",
        weights=("superpoint", "superpoint_lightglue"),
        input_size="1024 px, longer side",
        bytes_per_pixel=2000.0,  # not measured: that of ALIKED
    ),
)
def superpoint(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """SuperPoint as published, on luma; 256 values each."""
    import torch

    from zpm2.features import superpoint_network
    from zpm2.features.network_detector import with_lightglue

    network = superpoint_network.SuperPoint()
    network.load_state_dict(weights.load_state_dict("superpoint", progress=progress), strict=True)
    network.eval().to(device)
    luma = torch.tensor(LUMA, device=device).view(1, 3, 1, 1)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        gray = (pixels * luma).sum(1, keepdim=True)
        return superpoint_network.extract(network, gray, config.max_keypoints, config.superpoint_threshold)

    return with_lightglue("superpoint", extract, "superpoint_lightglue", config, device, progress)
