"""ALIKED (Zhao et al., IEEE TIM 2023) in three sizes, and LightGlue."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo

if TYPE_CHECKING:
    import torch

INFO = ModelInfo(
    task="points with a detector, LightGlue",
    code_licence="Apache-2.0",
    training_data="MegaDepth, and homographies",
    input_size="1024 px, longer side",
    bytes_per_pixel=1000.0,
)
MODELS = {"aliked": "n16", "aliked-n16rot": "n16rot", "aliked-n32": "n32"}  # as published, by our names


def aliked(name: str, config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """One of `MODELS`: maxima of 5 x 5 px to sub-pixel, 128 values each."""
    from zpm2.features.aliked_network import AlikedNetwork
    from zpm2.features.network_detector import with_lightglue

    model = MODELS[name]
    network = AlikedNetwork(
        f"aliked-{model}", max_num_keypoints=config.max_keypoints, detection_threshold=config.aliked_threshold
    )
    state = weights.load_state_dict(f"aliked_{model}", progress=progress)
    state["dkd.hw_grid"] = network.dkd.hw_grid  # computed, not learned
    network.load_state_dict(state, strict=True)
    network.eval().to(device)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return [(f.keypoints, f.descriptors, f.keypoint_scores) for f in network(pixels)]

    return with_lightglue(name, extract, "aliked_lightglue", config, device, progress)


for _name, _model in MODELS.items():
    point_matcher(_name, replace(INFO, weights=(f"aliked_{_model}", "aliked_lightglue")))(partial(aliked, _name))
