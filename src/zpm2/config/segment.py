"""Regions from pixels, and polygons from regions (paper 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from zpm2.config.fields import Word, named, number, option, options, share
from zpm2.errors import ConfigError

MEASURED = "measured, docs/results.md"


def _above_zero(name: str, value: Any) -> None:
    if not value or min(value) <= 0:
        raise ConfigError(f"{name} are one or more numbers above 0, got {','.join(map(str, value))}")


@dataclass(frozen=True)
class PromptConfig:
    """Which points of the grid are prompts at the faster levels of quality (`segment.automatic`)."""

    first: float = share(1 / 64, "of the grid: prompts for what is large, made before all others")
    fast_blobs: float = share(1 / 6, "of the grid: at most so many prompts at blobs, quality fast", source=MEASURED)
    balanced_blobs: float = share(1 / 3, "the same, quality balanced", source=MEASURED)
    fast_uncovered: float = share(
        1 / 4, "of the grid: at most so many prompts where no mask lies yet, quality fast", source=MEASURED
    )
    balanced_uncovered: float = share(1 / 2, "the same, quality balanced", source=MEASURED)
    max_mask_to_blob: float = number(
        6.0, "area of a mask by that of a blob in it, up to which the blob needs no prompt of its own", source=MEASURED
    )
    blob_sigmas: tuple[float, ...] = option(
        (1.5, 3.0, 6.0, 12.0),
        "of the Gaussians whose differences find blobs, each with one twice as wide",
        unit="px of a decoded mask",
        check=_above_zero,
    )
    blob_distance: float = number(1.5, "from a blob to the next one of its scale, at least", unit="sigmas", above=True)
    min_blob_contrast: float = number(
        0.5, "difference of a blob from its surroundings; no one sees less", unit="CIELAB"
    )


@dataclass(frozen=True)
class SegmentConfig:
    """Regions from pixels (paper 3.2). Thresholds are those of SAM's automatic mask generator."""

    model: str = option("mobile_sam", "name of a segmenter (zpm2 models), or package.module:Class", check=named)
    options: Mapping[str, Word] = options("of that segmenter")
    backend: Literal["auto", "openvino", "torch"] = option(
        "auto", "auto: openvino on a CPU where it is installed, else torch"
    )
    grid: int = number(32, "prompts along each image side, grid x grid in all", low=1, high=1000)
    quality: Literal["fast", "balanced", "full"] = option(
        "full", "full: all prompts of the grid; else those where a new region is likely"
    )
    cpu_batch: int = number(
        16, "prompts at a time on a CPU; the faster levels of quality choose the next ones after these", low=1, high=512
    )
    gpu_batch: int = number(64, "the same on a GPU", low=1, high=512)
    prompts: PromptConfig = field(default_factory=PromptConfig)
    min_predicted_iou: float = share(0.88, "masks below it are dropped: the model itself doubts them")
    min_stability: float = share(0.95, "IoU of the mask cut at +stability_offset and at -stability_offset")
    stability_offset: float = number(1.0, "see min_stability", unit="logits")
    nms_iou: float = share(0.7, "of two masks that overlap more, the one with the better score stays")
    min_area: float = number(
        100.0, "smaller regions, islands and holes are cleaned away", unit="px^2 of the original image"
    )
    min_decoded_area: float = share(
        0.5, "of min_area, for masks before they are brought to the image's resolution, where they may grow"
    )
    max_area: float = share(0.9, "of the image; larger masks are the image itself")


@dataclass(frozen=True)
class VectorizeConfig:
    """Polygons from regions (paper 3.2, Douglas-Peucker)."""

    tolerance: float = number(1.0, "Douglas-Peucker distance", unit="px")
    max_area_change: float = share(
        0.2, "of a polygon's area: one that simplification would change more keeps its exact outline"
    )
    min_contained: float = share(0.95, "of a polygon's area that lies in another one, which is then its parent")
