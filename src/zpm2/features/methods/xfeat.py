"""XFeat (Potje et al., CVPR 2024): its sparse points with LighterGlue, and whole cells without a detector."""

from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher

if TYPE_CHECKING:
    import torch


@point_matcher("xfeat", bytes_per_pixel=140.0)
def xfeat(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """The sparse head, 64 values each; see `zpm2.features.xfeat_network`."""
    from zpm2.features import xfeat_network
    from zpm2.features.network_detector import with_lightglue

    network = xfeat_network.load(device, progress)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return xfeat_network.extract(network, pixels, config.max_keypoints)

    return with_lightglue("xfeat", extract, "xfeat_lighterglue", config, device, progress)


@point_matcher("xfeat-dense", bytes_per_pixel=140.0)
def xfeat_dense(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """XFeat semi-dense; see `zpm2.features.xfeat_dense`."""
    from zpm2.features.xfeat_dense import XFeatDense

    return XFeatDense(config, device, progress)
