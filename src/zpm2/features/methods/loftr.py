"""LoFTR (Sun et al., CVPR 2021): points without a detector. The network is kornia's."""

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

OUTDOOR = ModelInfo(
    task="points in every cell of 8 px, without a detector",
    code_licence="Apache-2.0",
    training_data="MegaDepth",
    weights=("loftr_outdoor",),
    input_size="840 px, longer side",
    longest_side=840,
    bytes_per_pixel=3300.0,  # at that size; it grows with the fourth power of the side
)
MODELS = {
    "loftr-outdoor": OUTDOOR,
    "loftr-indoor": replace(
        OUTDOOR,
        training_data="ScanNet, whose terms forbid commercial use",
        weights=("loftr_indoor",),
        input_size="640 x 480 px",
        longest_side=640,
    ),
}


def loftr(name: str, config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """One of `MODELS`.

    The published network puts pixel centres at +0.5, as kornia documents: its training took depth maps and cameras of
    COLMAP.
    """
    import torch
    from kornia.feature.loftr.loftr import LoFTR, default_cfg

    from zpm2.features.frame import gray
    from zpm2.features.pair_network import PairNetworkMatcher

    info = MODELS[name]
    settings = {**default_cfg, "match_coarse": {**default_cfg["match_coarse"], "thr": config.loftr_threshold}}
    network = LoFTR(None, settings)
    state = weights.load_state_dict(info.weights[0], progress=progress)
    weights.load_into(network, {key.removeprefix("matcher."): value for key, value in state.items()}, info.weights[0])
    network.eval().to(device)

    def match(left: "torch.Tensor", right: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        found = network({"image0": gray(left), "image1": gray(right)})
        rows = [torch.nonzero(found["batch_indexes"] == k)[:, 0] for k in range(len(left))]
        return [(found["keypoints0"][r], found["keypoints1"][r], found["confidence"][r]) for r in rows]

    return PairNetworkMatcher(name, match, replace(config, max_size=config.side(info.longest_side)), device)


for _name, _info in MODELS.items():
    point_matcher(_name, _info)(partial(loftr, _name))
