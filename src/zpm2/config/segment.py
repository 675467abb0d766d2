"""Regions from pixels, and polygons from regions (paper 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import Word, named, number, option, options, share
from zpm2.errors import ConfigError

MEASURED = "measured, docs/results.md"
CLOSER = "measured, docs/segmenters.md"


def _above_zero(name: str, value: tuple[float, ...]) -> None:
    if not value or min(value) <= 0:
        raise ConfigError(f"{name} are one or more numbers above 0, got {','.join(map(str, value))}")


@dataclass(frozen=True)
class PromptConfig:
    """Which points of the grid are prompts at the faster levels of quality (`segment.automatic`)."""

    first: float = share(
        1 / 64, "of the grid: prompts for what is large, made before all others", source="4 x 4 of 32 x 32 points"
    )
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
        source="blobs from 4 to 34 px wide, a 64th to an eighth of the image",
    )
    chosen: int = number(
        16,
        "prompts that are chosen at a time, by what those before them have found",
        low=1,
        high=512,
        source="few, so that what is found keeps prompts away; more take less time on a GPU only",
    )
    blob_distance: float = number(1.5, "from a blob to the next one of its scale, at least", unit="sigmas", above=True)
    min_blob_contrast: float = number(
        0.5,
        "difference of a blob from its surroundings; no one sees less",
        unit="CIELAB",
        source="just noticeable: 2.3 (Mahy et al. 1994)",
    )


@dataclass(frozen=True)
class DetailConfig:
    """Where both images are looked at again, closer, in windows of the part that both show (`guided.detail`)."""

    level: Literal["off", "auto", "high"] = option(
        "off", "auto: where little of that part is matched; high: wherever smaller regions are likely", source=CLOSER
    )
    min_coverage: float = share(
        0.75, "of that part inside matched polygons, from which on level auto does not look closer", source=CLOSER
    )
    zoomed_coverage: float = share(
        0.85, "the same, of photographs whose scales differ by `zoom` or more", source=CLOSER
    )
    zoom: float = number(
        1.2,
        "one photograph's scale by the other's, from which on finer regions are likely",
        low=1.0,
        high=1000.0,
        source="a fifth: far more than between the cameras of a stereo pair",
    )
    auto_windows: int = number(3, "at most, level auto", high=1000, source=CLOSER)
    high_windows: int = number(
        21, "at most, level high", high=1000, source="the part as a whole, 2 x 2 and 4 x 4 windows"
    )
    auto_halvings: int = number(1, "of a window's side, at most, level auto", high=10, source=CLOSER)
    high_halvings: int = number(2, "the same, level high", high=10, source="elements a quarter as large")
    side: float = share(
        0.6, "of the side of that part: the windows of the first halving", above=True, source="they overlap by a fifth"
    )
    max_part: float = share(
        0.75,
        "of an image's longer side: up to it, the part that both show is a window of its own",
        source="regions are then a third larger",
    )
    min_side: int = number(
        256, "shorter windows show nothing new", unit="px", low=32, source="a decoded mask then has the image's pixels"
    )
    grid: int = number(
        20,
        "`segment.grid` of a window",
        low=1,
        high=1000,
        source="0.6 of 32: as dense on the image as the whole view's",
    )
    cells: int = number(
        32, "along an image's longer side, that tell which parts both show", low=4, high=256, source="as segment.grid"
    )
    min_blobs: int = number(
        8, "in a window, of which no matched region of their size is known", high=100_000, source="fewer do not pay"
    )
    min_overlap: float = share(
        0.6, "`local_match.min_overlap` of what a window shows", source="small regions overlap by chance more often"
    )
    min_points: int = number(
        1,
        "homologous points that such a match shares",
        high=10_000,
        source="without any, neighbours alone place it: 23 of 35 were right, and 154 of 166 others",
    )
    reach: float = number(
        12.0,
        "from a prompt of a window to the next homologous point, at most",
        unit="px of a decoded mask",
        high=1000.0,
        source=CLOSER,
    )
    min_new: int = number(
        2, "matches that a window must add, else it is the last one of its size", high=100_000, source=CLOSER
    )


@dataclass(frozen=True)
class FamilyConfig:
    """Elements that repeat: bricks, windows, roof tiles (`segment.family`). Looked for in windows of `DetailConfig`."""

    max_prompts: int = number(48, "in a window, at most; 0: look for no families", high=100_000, source="limits time")
    max_seeds: int = number(
        24, "regions that are correlated with a window, at most", high=10_000, source="time grows with them"
    )
    min_members: int = number(
        4, "elements that look alike, from which on they are a family", low=2, high=1000, source="two are chance"
    )
    min_correlation: float = share(
        0.6, "of an element's surroundings with those of the first one", source="above what neighbouring texture has"
    )
    margin: float = share(
        0.25, "of the shorter side of an element's box, around it, that must look alike too", source="holds the joints"
    )
    min_side: int = number(4, "of an element's box", unit="px of a decoded mask", low=2, high=256, source="as blobs")
    max_side: float = share(0.25, "of the view, which an element's box may have", source="four fit beside each other")
    min_overlap: float = share(
        0.7,
        "IoU of an element with the first one, moved there",
        source="as guided.min_overlap: same size and shape",
    )
    known_overlap: float = share(0.5, "IoU with a known region, from which on there is no prompt", source="as a match")


@dataclass(frozen=True)
class SegmentConfig:
    """Regions from pixels (paper 3.2). Thresholds are those of SAM's automatic mask generator."""

    model: str = option(
        "mobile_sam",
        "name of a segmenter (zpm2 models), or package.module:Class",
        source="paper 3.2; MobileSAM: Zhang et al. 2023",
        check=named,
    )
    options: Mapping[str, Word] = options("of that segmenter")
    backend: Literal["auto", "openvino", "torch"] = option(
        "auto", "auto: openvino on a CPU where it is installed, else torch"
    )
    precision: Literal["float32", "float16", "bfloat16"] = option(
        "float32",
        "of the networks' arithmetic; half of it is faster where the device has units for it",
        source=MEASURED,
    )
    padding: int = number(
        0,
        "image tokens, at least, that stand for the part of SAM's square that a photograph leaves empty; 0: all of "
        "them",
        high=4096,
        source="measured, docs/optimisation.md",
    )
    vicinity: int = number(
        0,
        "blocks of 4 x 4 image tokens along the sides of the window that a prompt for something small sees, of the 16 "
        "along SAM's square; 0: it sees all tokens",
        high=16,
        source="measured, docs/optimisation.md",
    )
    grid: int = number(
        32,
        "prompts along each image side, grid x grid in all",
        low=1,
        high=1000,
        source="SAM's automatic mask generator",
    )
    quality: Literal["fast", "balanced", "full"] = option(
        "full", "full: all prompts of the grid; else those where a new region is likely"
    )
    cpu_batch: int = number(
        16,
        "prompts that go to the network at a time on a CPU",
        low=1,
        high=512,
        source="as many as `segment.prompts.chosen`: more bring nothing there; SAM: 64",
    )
    gpu_batch: int = number(64, "the same on a GPU", low=1, high=512, source="SAM's automatic mask generator")
    prompts: PromptConfig = field(default_factory=PromptConfig)
    detail: DetailConfig = field(default_factory=DetailConfig)
    family: FamilyConfig = field(default_factory=FamilyConfig)
    min_predicted_iou: float = share(
        0.88, "masks below it are dropped: the model itself doubts them", source="SAM's automatic mask generator"
    )
    min_stability: float = share(
        0.95,
        "IoU of the mask cut at +stability_offset and at -stability_offset",
        source="SAM's automatic mask generator",
    )
    stability_offset: float = number(1.0, "see min_stability", unit="logits", source="SAM's automatic mask generator")
    nms_iou: float = share(
        0.7,
        "of two masks that overlap more, the one with the better score stays",
        source="SAM's automatic mask generator",
    )
    min_area: float = number(
        100.0,
        "smaller regions, islands and holes are cleaned away",
        unit="px^2 of the original image",
        source="10 x 10 px: smaller regions have too little texture to be compared",
    )
    min_decoded_area: float = share(
        0.5, "of min_area, for masks before they are brought to the image's resolution, where they may grow"
    )
    max_area: float = share(
        0.9, "of the image; larger masks are the image itself", source="the whole image has no outline of its own"
    )


@dataclass(frozen=True)
class VectorizeConfig:
    """Polygons from regions (paper 3.2, Douglas-Peucker)."""

    tolerance: float = number(
        1.0, "Douglas-Peucker distance", unit="px", source="an outline along pixel edges is exact to half a px"
    )
    max_area_change: float = share(
        0.2,
        "of a polygon's area: one that simplification would change more keeps its exact outline",
        source="thin things would collapse",
    )
    min_contained: float = share(
        0.95,
        "of a polygon's area that lies in another one, which is then its parent",
        source="outlines of two masks differ by a px or two",
    )
