"""XFeat (Potje et al., CVPR 2024): its sparse points with LighterGlue, and whole cells without a detector."""

from dataclasses import replace
from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo

if TYPE_CHECKING:
    import torch


INFO = ModelInfo(
    task="points with a detector, LighterGlue",
    code_licence="Apache-2.0",
    training_data="MegaDepth, and homographies of COCO",
    weights=("xfeat", "xfeat_lighterglue"),
    input_size="800 x 600 px",
    bytes_per_pixel=140.0,
)


@point_matcher("xfeat", INFO)
def xfeat(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """The sparse head, 64 values each; see `zpm2.features.xfeat_network`."""
    from zpm2.features import xfeat_network
    from zpm2.features.network_detector import with_lightglue

    network = xfeat_network.load(device, progress)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return xfeat_network.extract(network, pixels, config.max_keypoints)

    return with_lightglue("xfeat", extract, "xfeat_lighterglue", config, device, progress)


@point_matcher(
    "xfeat-dense", replace(INFO, task="points in every cell of 8 px, without a detector", weights=("xfeat",))
)
def xfeat_dense(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """XFeat semi-dense; see `zpm2.features.xfeat_dense`."""
    from zpm2.features.xfeat_dense import XFeatDense

    return XFeatDense(config, device, progress)
