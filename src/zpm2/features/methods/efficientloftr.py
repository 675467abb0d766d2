"""Efficient LoFTR (Wang et al., CVPR 2024): points without a detector. The network is that of `transformers`."""

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
    task="points in every cell of 8 px, without a detector",
    code_licence="Apache-2.0",
    training_data="MegaDepth",
    weights=("efficientloftr",),
    input_size="832 px, longer side",
    longest_side=832,
    bytes_per_pixel=4000.0,  # at that size; it grows with the fourth power of the side
    extra="hf",
    packages=("transformers", "safetensors"),
)


@point_matcher("efficientloftr", INFO)
def efficientloftr(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """The full model as published; see `zpm2.features.efficientloftr_network`."""
    from zpm2.features import efficientloftr_network
    from zpm2.features.frame import gray, padded_alike
    from zpm2.features.pair_network import PairNetworkMatcher
    from zpm2.features.transformers_package import transformers

    package = transformers()
    network = package.EfficientLoFTRForKeypointMatching(package.EfficientLoFTRConfig())
    weights.load_into(network, weights.load_state_dict("efficientloftr", progress=progress), "efficientloftr")
    network.eval().to(device)

    def match(left: "torch.Tensor", right: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        alike = padded_alike(gray(left), gray(right))
        return efficientloftr_network.match(network, *alike, config.loftr_threshold)

    return PairNetworkMatcher("efficientloftr", match, replace(config, max_size=config.side(INFO.longest_side)), device)
