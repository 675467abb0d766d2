"""Regions from pixels, and polygons from regions (paper 3.2)."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class SegmentConfig:
    """Regions from pixels (paper 3.2). Thresholds are those of SAM's automatic mask generator."""

    model: Literal["mobile_sam", "vit_b", "vit_l", "vit_h"] = option(
        "mobile_sam", "MobileSAM, or one of the larger SAMs"
    )
    backend: Literal["auto", "openvino", "torch"] = option(
        "auto", "auto: openvino on a CPU where it is installed, else torch"
    )
    grid: int = number(32, "prompts along each image side, grid x grid in all", low=1, high=1000)
    quality: Literal["fast", "balanced", "full"] = option(
        "full", "full: all prompts; else those where something new may lie"
    )
    min_predicted_iou: float = share(0.88, "masks that the model itself doubts are dropped")
    min_stability: float = share(0.95, "IoU of the mask cut at +offset and -offset")
    stability_offset: float = number(1.0, "see min_stability", unit="logits")
    nms_iou: float = share(0.7, "of two masks that overlap more, the one with the better score stays")
    min_area: float = number(
        100.0, "smaller regions, islands and holes are cleaned away", unit="px^2 of the original image"
    )
    max_area: float = share(0.9, "of the image; larger masks are the image itself")


@dataclass(frozen=True)
class VectorizeConfig:
    """Polygons from regions (paper 3.2, Douglas-Peucker)."""

    tolerance: float = number(1.0, "Douglas-Peucker distance", unit="px")
