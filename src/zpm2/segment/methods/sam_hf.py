"""SAM 2.1, EdgeTAM, SAM-HQ and SAM 3 by the library transformers; see `zpm2.segment.transformers_sam`."""

from collections.abc import Callable

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.plugins import ModelInfo
from zpm2.segment.protocol import Segmenter
from zpm2.segment.registry import segmenter

# By name: training data, size that is seen, and the memory that the networks take while they work, in bytes, by the
# size of their weights, not measured.
MODELS = {
    "sam2.1_tiny": ("SA-1B, SA-V", "1024 x 1024 px, stretched", 2.5e9),
    "sam2.1_small": ("SA-1B, SA-V", "1024 x 1024 px, stretched", 2.6e9),
    "sam2.1_base_plus": ("SA-1B, SA-V", "1024 x 1024 px, stretched", 3e9),
    "sam2.1_large": ("SA-1B, SA-V", "1024 x 1024 px, stretched", 4e9),
    "edgetam": ("SA-1B, SA-V", "1024 x 1024 px, stretched", 2.5e9),
    "sam_hq_b": ("SA-1B, HQSeg-44K", "1024 px, longer side", 4e9),
    "sam_hq_l": ("SA-1B, HQSeg-44K", "1024 px, longer side", 6e9),
    "sam_hq_h": ("SA-1B, HQSeg-44K", "1024 px, longer side", 9e9),
    "sam3": ("SA-1B, SA-V, SA-Co", "1008 x 1008 px, stretched", 8e9),
}


def sam_hf(
    config: SegmentConfig, device: str, progress: Callable[[float], None], download: weights.Progress
) -> Segmenter:
    """The one that `config.model` names, with its network loaded."""
    from zpm2.segment.mask_network import NetworkSegmenter
    from zpm2.segment.transformers_sam import TransformersSam

    network = TransformersSam(config.model, config, device, download)
    return NetworkSegmenter(config.model, config, network, network.notes, progress)


for _name, (_data, _seen, _bytes) in MODELS.items():
    segmenter(
        _name,
        ModelInfo(
            task="regions of all kinds; takes prompts",
            code_licence="Apache-2.0",
            training_data=_data,
            weights=(_name,),
            input_size=_seen,
            working_bytes=_bytes,
            extra="hf",
            packages=("transformers", "safetensors", *(("timm",) if _name == "edgetam" else ())),
        ),
    )(sam_hf)
