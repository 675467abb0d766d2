"""ALIKED (Zhao et al., IEEE TIM 2023) in three sizes, and LightGlue."""

from functools import partial
from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher

if TYPE_CHECKING:
    import torch

MODELS = {"aliked": "n16", "aliked-n16rot": "n16rot", "aliked-n32": "n32"}  # as published, by our names


def aliked(name: str, config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """One of `MODELS`: maxima of 5 x 5 px to sub-pixel, 128 values each."""
    from kornia.feature import ALIKED

    from zpm2.features.network_detector import with_lightglue

    model = MODELS[name]
    network = ALIKED(
        f"aliked-{model}", max_num_keypoints=config.max_keypoints, detection_threshold=config.aliked_threshold
    )
    state = weights.load_state_dict(f"aliked_{model}", progress=progress)
    state["dkd.hw_grid"] = network.dkd.hw_grid  # computed, not learned
    network.load_state_dict(state, strict=True)
    network.eval().to(device)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return [(f.keypoints, f.descriptors, f.keypoint_scores) for f in network(pixels)]

    return with_lightglue(name, extract, "aliked_lightglue", config, device, progress)


for _name in MODELS:
    point_matcher(_name, bytes_per_pixel=2000.0)(partial(aliked, _name))
