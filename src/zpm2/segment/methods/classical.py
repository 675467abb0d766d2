"""Regions by colour, without any weights; see `zpm2.segment.classical`."""

from collections.abc import Callable

from zpm2.config import SegmentConfig
from zpm2.plugins import ModelInfo
from zpm2.segment.protocol import Segmenter
from zpm2.segment.registry import segmenter


@segmenter(
    "classical",
    ModelInfo(
        task="regions of one colour, without weights; takes prompts",
        code_licence="Apache-2.0",
        training_data="none",
        input_size="512 px, longer side",
        working_bytes=0.3e9,
        device="cpu",
    ),
)
def classical(
    config: SegmentConfig, progress: Callable[[float], None], *, smoothing: float = 1.0, noise: float = 1.0
) -> Segmenter:
    """The segmenter; its options are described there."""
    from zpm2.segment.classical import ClassicalSegmenter

    return ClassicalSegmenter(config, progress, smoothing=smoothing, noise=noise)
