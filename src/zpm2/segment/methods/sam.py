"""SAM (Kirillov et al., ICCV 2023) in three sizes, and MobileSAM (Zhang et al. 2023), whose encoder is a small one."""

from collections.abc import Callable

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.plugins import ModelInfo
from zpm2.segment.protocol import Segmenter
from zpm2.segment.registry import segmenter

# By name: the weights, their training data, and the memory that the networks take while they work, in bytes. It was
# measured for MobileSAM (see `zpm2.estimate`); for the others it follows from the size of their weights.
MODELS = {
    "mobile_sam": ("mobile_sam", "1 % of SA-1B, distilled from SAM ViT-H", 1.4e9),
    "vit_b": ("sam_vit_b", "SA-1B", 3e9),
    "vit_l": ("sam_vit_l", "SA-1B", 5e9),
    "vit_h": ("sam_vit_h", "SA-1B", 8e9),
}


def sam(
    config: SegmentConfig,
    device: str,
    say: Callable[[str], None],
    progress: Callable[[float], None],
    download: weights.Progress,
) -> Segmenter:
    """The one that `config.model` names, with its networks loaded; see `zpm2.segment.sam`."""
    from zpm2.segment.sam import SamSegmenter

    made = SamSegmenter(config, device, say, progress, download)
    made.load()
    return made


for _name, (_file, _data, _bytes) in MODELS.items():
    segmenter(
        _name,
        ModelInfo(
            task="regions of all kinds; takes prompts",
            code_licence="Apache-2.0",
            training_data=_data,
            weights=(_file,),
            input_size="1024 px, longer side",
            working_bytes=_bytes,
        ),
    )(sam)
