"""SuperPoint (DeTone et al., CVPR Workshops 2018) with LightGlue or with SuperGlue."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher, SparseMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo

if TYPE_CHECKING:
    import torch

    from zpm2.features.network_detector import Extract

INFO = ModelInfo(
    task="points with a detector, LightGlue",
    code_licence="Apache-2.0",
    training_data="synthetic shapes and COCO; LightGlue: MegaDepth",
    weights=("superpoint", "superpoint_lightglue"),
    input_size="1024 px, longer side",
    bytes_per_pixel=1000.0,
)
OUTDOOR = replace(
    INFO,
    task="points with a detector, SuperGlue",
    bytes_per_pixel=2000.0,  # not measured: with room for SuperGlue's matrices of all points with all points
    training_data="synthetic shapes and COCO; SuperGlue: MegaDepth",
    weights=("superpoint", "superglue_outdoor"),
    input_size="1600 px, longer side",
    longest_side=1600,
    extra="hf",
    packages=("transformers", "safetensors"),
)
SUPERGLUE = {
    "superglue-outdoor": OUTDOOR,
    "superglue-indoor": replace(
        OUTDOOR,
        training_data="synthetic shapes and COCO; SuperGlue: ScanNet",
        weights=("superpoint", "superglue_indoor"),
        input_size="640 x 480 px",
        longest_side=640,
    ),
}


@point_matcher("superpoint", INFO)
def superpoint(config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """SuperPoint as published, on luma; 256 values each."""
    from zpm2.features.network_detector import with_lightglue

    extract = _extract(config, device, progress)
    return with_lightglue("superpoint", extract, "superpoint_lightglue", config, device, progress)


def superglue(name: str, config: PointsConfig, device: str, progress: weights.Progress | None) -> PointMatcher:
    """The same points, paired by one of `SUPERGLUE`."""
    from zpm2.features.network_detector import NetworkDetector
    from zpm2.features.superglue import SuperGlueMatcher
    from zpm2.features.transformers_package import transformers

    info = SUPERGLUE[name]
    package = transformers()
    seen = replace(config, max_size=config.side(info.longest_side))
    detector = NetworkDetector(_extract(seen, device, progress), seen, device)
    return SparseMatcher(name, detector, SuperGlueMatcher(info.weights[1], package, device, progress))


def _extract(config: PointsConfig, device: str, progress: weights.Progress | None) -> "Extract":
    from zpm2.features import superpoint_network
    from zpm2.features.frame import gray

    network = superpoint_network.SuperPoint()
    network.load_state_dict(weights.load_state_dict("superpoint", progress=progress), strict=True)
    network.eval().to(device)

    def extract(pixels: "torch.Tensor") -> "list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]":
        return superpoint_network.extract(network, gray(pixels), config.max_keypoints, config.superpoint_threshold)

    return extract


for _name, _info in SUPERGLUE.items():
    point_matcher(_name, _info)(partial(superglue, _name))
