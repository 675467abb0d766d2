"""SAM 2 (Ravi et al. 2024), the tiny one, by ONNX Runtime; see `zpm2.segment.sam2_onnx`."""

from collections.abc import Callable

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.plugins import ModelInfo
from zpm2.segment.protocol import Segmenter
from zpm2.segment.registry import segmenter


@segmenter(
    "sam2_tiny",
    ModelInfo(
        task="regions of all kinds; takes prompts",
        code_licence="MIT",
        training_data="SA-1B, SA-V",
        weights=("sam2_tiny_encoder", "sam2_tiny_decoder"),
        input_size="1024 x 1024 px, stretched",
        working_bytes=2.2e9,
        extra="onnx",
        packages=("onnxruntime",),
    ),
)
def sam2_tiny(
    config: SegmentConfig, device: str, progress: Callable[[float], None], download: weights.Progress
) -> Segmenter:
    """The segmenter with its two graphs loaded."""
    from zpm2.segment.mask_network import NetworkSegmenter
    from zpm2.segment.sam2_onnx import open_network

    network, notes = open_network(config, device, download)
    return NetworkSegmenter(config.model, config, network, notes, progress)
