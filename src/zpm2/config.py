"""Every number of the method, one frozen dataclass per stage, and the presets that fill them.

`paper` holds the values of the paper's "Experimental environment" (4.1.3) wherever it prints one; `default` is the best
that we know, measured. A configuration is a value: compare it, print it, write it to a file and read it back.
"""

import dataclasses
import inspect
import re
import sys
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from zpm2 import memory
from zpm2.errors import ConfigError
from zpm2.files.reading import read_json, read_toml


@dataclass(frozen=True)
class SegmentConfig:
    """Regions from pixels (paper 3.2). Thresholds are those of SAM's automatic mask generator."""

    model: Literal["mobile_sam", "vit_b", "vit_l", "vit_h"] = "mobile_sam"  # MobileSAM, or one of the larger SAMs
    backend: Literal["auto", "openvino", "torch"] = "auto"  # auto: openvino on a CPU where it is installed, else torch
    grid: int = 32  # prompts along each image side, grid x grid in all
    quality: Literal["fast", "balanced", "full"] = "full"  # full: all prompts; else those where something new may lie
    min_predicted_iou: float = 0.88  # 0..1, masks that the model itself doubts are dropped
    min_stability: float = 0.95  # 0..1, IoU of the mask cut at +offset and -offset
    stability_offset: float = 1.0  # logits
    nms_iou: float = 0.7  # of two masks that overlap more, the one with the better score stays
    min_area: float = 100.0  # px^2 of the original image; smaller regions, islands and holes are cleaned away
    max_area: float = 0.9  # share of the image; larger masks are the image itself


@dataclass(frozen=True)
class VectorizeConfig:
    """Polygons from regions (paper 3.2, Douglas-Peucker)."""

    tolerance: float = 1.0  # px, Douglas-Peucker distance


@dataclass(frozen=True)
class PointsConfig:
    """Homologous points (paper 3.2). Several matchers are combined, as the paper does."""

    methods: tuple[str, ...] = ("xfeat",)  # see zpm2.features.METHODS
    max_keypoints: int = 4096  # per image and method
    max_size: int = 1600  # px, the longer image side given to learned detectors; points come back in original px
    min_score: float = 0.1  # 0..1, the matcher's own
    look_again: bool = False  # smaller and turned, where few points agree on one geometry


@dataclass(frozen=True)
class GlobalConfig:
    """Initial geometry and bidirectional pyramid (paper 3.3, Algorithm 1)."""

    epipolar_px: float = 3.0  # px, MAGSAC++ threshold of F and the "sufficiently close" of 3.3.1
    homography_px: float = 6.0  # px, MAGSAC++ threshold of H
    search: Literal["pyramid", "fixed"] = "pyramid"  # fixed: a window as wide as the polygon's shorter side (4.4.1)
    factor: int = 3  # pyramid downsampling factor
    top_size: int = 200  # px, downsampling stops when a side of the top level is no longer than this
    max_layers: int = 10  # of the pyramid, full resolution included
    phi: int = 15  # px, template window W_phi, odd
    tau: int = 25  # px, half of the initial search window W_tau, hence 50 x 50
    band: float = 3.0  # px of the pyramid level, distance to the epipolar line (epsilon of 3.3.2)
    min_contrast: float = 2.0  # grey levels, standard deviation under which a template has no texture


@dataclass(frozen=True)
class LocalConfig:
    """Local matcher (paper 3.4): shape, texture, cost and assignment."""

    shape: Literal["graph", "overlap"] = "graph"  # psi from the paper's graph descriptor, or from rectified overlap
    assign: Literal["optimal", "greedy"] = "optimal"  # greedy: highest psi, one polygon after the other (4.4.2)
    neighbors: int = 8  # k of the node embedding
    z: float = 5.0  # scaling factor of beta
    gamma: int = 8  # DSF from which a local homography is estimated
    few_points: bool = False  # below gamma, DSF counts for its share where it says more than texture
    iota: float = 5.0  # similarity threshold: a pair that costs more stays unmatched
    epsilon: float = 1e-6  # of the cost
    patch: int = 32  # px, side of the resampled texture patches
    min_overlap: float = 0.3  # 0..1, IoU of the rectified polygon with its candidate under which they cannot match


@dataclass(frozen=True)
class GuidedConfig:
    """Guided re-detection: the segmenter is asked in one image about the polygons of the other."""

    direction: Literal["off", "forward", "both"] = "off"  # forward: left polygons in the right image only
    min_overlap: float = 0.7  # 0..1, IoU of an answer with the carried polygon that it was asked for
    min_predicted_iou: float = 0.7  # 0..1, lower than `segment`'s: agreement between the images is evidence too
    min_stability: float = 0.85  # 0..1, the same
    min_match_overlap: float = 0.5  # 0..1, `local_match.min_overlap` of pairs in which one mask was below `segment`'s


@dataclass(frozen=True)
class RasterConfig:
    """Georeferenced and many-band photographs (extra `geo`)."""

    bands: tuple[int, ...] = ()  # one (grey) or three (R, G, B), from 1 on; none: those that the file says are colours
    gsd: tuple[float, ...] = ()  # m on the ground per px, one or left and right; none: what the files say
    min_area_m2: float = 0.0  # m^2 on the ground; smaller polygons are left out, `segment.min_area` counts too


@dataclass(frozen=True)
class TilesConfig:
    """Large photographs, seen in overlapping tiles of several scales."""

    mode: Literal["off", "on", "auto"] = "off"  # auto: where one has more than 16 megapixels, or is thin
    size: int = 2048  # px, side of the finest tiles; each level above has tiles three times as wide
    overlap: float = 0.125  # 0..1, share of a tile's side that neighbouring tiles have in common at least
    outside: bool = True  # also segment what only one of the photographs shows


@dataclass(frozen=True)
class PoseConfig:
    """Relative pose from matched polygons (paper 3.5.1)."""

    estimator: Literal["opencv", "poselib", "auto"] = "opencv"  # MAGSAC++; LO-RANSAC; auto: poselib if it is there
    noise_px: float = 1.0  # px, threshold of the estimator; more where images were reduced to points.max_size
    points: Literal["regions", "all"] = "regions"  # of the whole images: those in matched regions (M1 filtered), or all
    crops: Literal["boxes", "rectified", "off"] = "boxes"  # M2: boxes of both polygons, or the right one as the left
    crop_size: int = 480  # px, side of a crop
    crop_points: int = 512  # per crop
    max_crops: int = 40  # of rectified crops, the surest matches first
    inflation: float = 1.8  # of standard deviations, measured on pairs with known poses (docs/pose.md)
    bucket: int = 0  # points kept in each of 8 x 8 cells of the left image, best first; 0: all


@dataclass(frozen=True)
class CloudConfig:
    """Polygons lifted onto a surface (paper 3.5.2). The paper prints none of these numbers."""

    diffusion: Literal["scale", "surface"] = "scale"  # one scale for all of it, or its part on one surface
    step: float = 2.0  # px, delta: samples of a boundary are no farther apart
    min_scale: float = 0.4  # s_min: a polygon that must shrink further, to less than its square of area, is rejected
    halvings: int = 6  # of the interval of scales, from s_min to 1
    max_edge: float = 6.0  # tau, medians: a longer edge between samples, per px, leads to another surface
    max_fold: float = 100.0  # degrees between normals of neighbouring samples, beyond which the surface is folded
    max_size: float = 20.0  # times the size that it would have facing the camera; roads are seen at a small angle
    min_overlap: float = 0.5  # 0..1, IoU of a lifted polygon, seen from the other camera, with its partner there
    max_distance: float = 0.25  # of sqrt(area): distance between the boundaries that both views lift
    fill: float = 0.02  # of the mesh's extent: holes up to this wide are filled
    neighbors: int = 2  # views that each view is matched with
    same: float = 0.75  # 0..1, IoU from which on two regions of an image, or two patches, are one


@dataclass(frozen=True)
class Config:
    """The whole method."""

    segment: SegmentConfig = field(default_factory=SegmentConfig)
    vectorize: VectorizeConfig = field(default_factory=VectorizeConfig)
    points: PointsConfig = field(default_factory=PointsConfig)
    global_match: GlobalConfig = field(default_factory=GlobalConfig)
    local_match: LocalConfig = field(default_factory=LocalConfig)
    guided: GuidedConfig = field(default_factory=GuidedConfig)
    raster: RasterConfig = field(default_factory=RasterConfig)
    tiles: TilesConfig = field(default_factory=TilesConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    seed: int = 0  # of everything random
    device: str = "auto"  # auto, cpu, cuda
    max_memory: str = "auto"  # 8GB, 512MB, ...; auto: 80 % of what is free; none: no limit

    def __post_init__(self) -> None:
        for stage in dataclasses.fields(self):
            value = getattr(self, stage.name)
            if not dataclasses.is_dataclass(value):
                _check_range(stage.name, value)
                continue
            for item in dataclasses.fields(value):
                _check_range(f"{stage.name}.{item.name}", getattr(value, item.name))

    def check_together(self) -> None:
        """`ConfigError` for values that are good each, and not together. `--set` may pass through such."""
        phi, window = self.global_match.phi, 2 * self.global_match.tau
        if phi > window:
            raise ConfigError(
                f"global_match.phi={phi} is wider than the search window of 2 x global_match.tau={window} px: give a "
                "smaller phi, or a larger tau"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionaries, as in `matches.json`."""
        return dataclasses.asdict(self)

    @staticmethod
    def from_dict(values: Mapping[str, Any], base: "Config | None" = None) -> "Config":
        """`base` (else the defaults) with `values` laid over it. Unknown names and wrong types raise `ConfigError`."""
        return _overlay(base or Config(), values, "")


def preset(name: str) -> Config:
    """The configuration of that name; `ConfigError` names the ones that exist."""
    if name not in PRESETS:
        raise ConfigError(f"unknown preset '{name}'{_hint(name, PRESETS)}; presets are: {', '.join(PRESETS)}")
    return PRESETS[name]


def load(path: str | Path, base: Config | None = None) -> Config:
    """A configuration from a .toml or .json file, laid over `base`."""
    path = Path(path)
    try:
        values = read_json(path) if path.suffix.lower() == ".json" else read_toml(path)
    except OSError as error:
        raise ConfigError(f"cannot read configuration {path}: {error.strerror}") from error
    except RecursionError as error:
        raise ConfigError(f"configuration {path} is nested too deeply: it holds stages with fields only") from error
    except ValueError as error:
        raise ConfigError(f"configuration {path} is not valid {path.suffix.lstrip('.') or 'TOML'}: {error}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"configuration {path} must hold a table of stages, got {type(values).__name__}")
    return Config.from_dict(values, base)


def assign(config: Config, settings: Sequence[str]) -> Config:
    """`config` with each "stage.field=value" of `settings` applied (the command line's `--set`).

    >>> assign(Config(), ["segment.grid=16", "points.methods=sift,xfeat"]).points.methods
    ('sift', 'xfeat')
    """
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"--set {setting}: expected stage.field=value, for example segment.grid=16")
        values: Any = text
        for name in reversed(key.strip().split(".")):
            values = {name: values}
        config = Config.from_dict(values, config)
    return config


def with_options(config: Config, options: Mapping[str, Any]) -> Config:
    """`config` with those `options`, by their names in `OPTIONS`, that are not None.

    >>> with_options(Config(), {"quality": "fast", "seed": None}).segment.quality
    'fast'
    """
    for name, value in options.items():
        if name not in OPTIONS:
            raise ConfigError(f"unknown option '{name}'{_hint(name, OPTIONS)}; options are: {', '.join(OPTIONS)}")
        if value is not None:
            for part in reversed(OPTIONS[name].split(".")):
                value = {part: value}
            config = Config.from_dict(value, config)
    return config


def choices(key: str) -> tuple[str, ...]:
    """The values that a "stage.field" may have, where they are words that can be told; else none."""
    kind: Any = Config
    for part in key.split("."):
        kind = typing.get_type_hints(kind)[part]
    return typing.get_args(kind) if typing.get_origin(kind) is Literal else ()


def describe(config: Config) -> Iterator[tuple[str, str, Any, str]]:
    """Of every field "stage.field", its type, its value in `config`, and what it means (the comment beside it here)."""
    source = inspect.getsource(sys.modules[__name__])
    for stage in dataclasses.fields(config):
        value = getattr(config, stage.name)
        holder, prefix = (value, f"{stage.name}.") if dataclasses.is_dataclass(value) else (config, "")
        body = source[source.index(f"class {type(holder).__name__}:") :]
        for item in dataclasses.fields(holder) if prefix else [stage]:
            kind = typing.get_type_hints(type(holder))[item.name]
            comment = re.search(rf"^    {item.name}: .*?(?:# (.*))?$", body, re.M)
            meaning = comment[1] or "" if comment else ""
            yield prefix + item.name, _type_name(kind), getattr(holder, item.name), meaning


def _type_name(kind: Any) -> str:
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is Literal:
        return " | ".join(arguments)
    if typing.get_origin(kind) is tuple:
        return f"{_type_name(arguments[0])},..."
    return str(kind.__name__)


def _check_range(name: str, value: Any) -> None:
    numbers = [v for v in (value if isinstance(value, tuple) else (value,)) if isinstance(v, int | float)]
    if any(v != v or v < 0 or v == float("inf") for v in numbers):
        raise ConfigError(f"{name} must be a finite number >= 0, got {value}")
    most = MOST.get(name, LARGEST)
    if any(v > most for v in numbers):
        raise ConfigError(f"{name} must be at most {most}, got {_short(max(numbers))}")
    if (
        name
        in (
            "segment.grid",
            "points.max_keypoints",
            "global_match.top_size",
            "global_match.tau",
            "local_match.neighbors",
            "global_match.max_layers",
            "pose.crop_points",
            "pose.max_crops",
            "cloud.neighbors",
        )
        and value < 1
    ):
        raise ConfigError(f"{name} must be at least 1, got {value}")
    if name == "max_memory" and value != memory.AUTO:
        memory.size(value)
    if name == "global_match.phi" and (value < 3 or value % 2 == 0):
        raise ConfigError(f"{name} must be odd and at least 3 px, got {value}")
    if name == "global_match.factor" and value < 2:
        raise ConfigError(f"{name} must be at least 2, got {value}")
    if name in ("pose.crop_size", "points.max_size") and value < 32:
        raise ConfigError(f"{name} must be at least 32 px, got {value}")
    if name in ("pose.noise_px", "pose.inflation", "cloud.step", "cloud.min_scale") and value == 0:
        raise ConfigError(f"{name} must be above 0, got {value}")
    if name == "tiles.size" and value < 256:
        raise ConfigError(f"{name} must be at least 256 px, got {value}")
    if name == "tiles.overlap" and value > 0.5:
        raise ConfigError(f"{name} is a share from 0 to 0.5, got {value}")
    if name == "raster.bands" and (len(value) not in (0, 1, 3) or min(value, default=1) < 1):
        raise ConfigError(f"{name} are one or three band numbers from 1 on, got {','.join(map(str, value))}")
    if name == "raster.gsd" and (len(value) > 2 or min(value, default=1) <= 0):
        raise ConfigError(f"{name} is one number of m per px above 0, or two (left, right)")
    if name == "local_match.patch" and value < 4:
        raise ConfigError(f"{name} must be at least 4 px, got {value}")
    if name in SHARES and value > 1:
        raise ConfigError(f"{name} is a share from 0 to 1, got {value}")
    if name == "points.methods" and not all(value or ("",)):
        raise ConfigError("points.methods is empty: name at least one, for example sift")


def _hint(name: str, known: Any) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def _overlay(base: Any, values: Any, where: str) -> Any:
    if not isinstance(values, Mapping):
        raise ConfigError(
            f"option '{where.rstrip('.')}' is a stage; set one of its fields: "
            f"{', '.join(f.name for f in dataclasses.fields(base))}"
        )
    types_of = typing.get_type_hints(type(base))
    changed = {}
    for name, value in values.items():
        if name not in types_of:
            raise ConfigError(
                f"unknown option '{where}{name}'{_hint(name, types_of)}; known here: {', '.join(types_of)}"
            )
        current = getattr(base, name)
        if dataclasses.is_dataclass(current):
            changed[name] = _overlay(current, value, f"{where}{name}.")
        else:
            changed[name] = _convert(value, types_of[name], f"{where}{name}")
    return dataclasses.replace(base, **changed)


def _convert(value: Any, kind: Any, name: str) -> Any:
    """`value` (a string from the command line, or a parsed TOML/JSON value) as the field's type."""
    origin = typing.get_origin(kind)
    if origin is Literal:
        choices = typing.get_args(kind)
        if value in choices:
            return value
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, got '{value}'")
    if origin is tuple:
        parts = value.split(",") if isinstance(value, str) else (value,) if isinstance(value, int | float) else value
        if not isinstance(parts, list | tuple):
            raise ConfigError(f"{name} must be a list, got '{value}'")
        return tuple(_convert(p.strip() if isinstance(p, str) else p, typing.get_args(kind)[0], name) for p in parts)
    if origin in (types.UnionType, typing.Union):
        if value is None or value == "none":
            return None
        return _convert(value, next(a for a in typing.get_args(kind) if a is not type(None)), name)
    try:
        if kind is bool and isinstance(value, str):
            return {"true": True, "false": False}[value.lower()]
        if isinstance(value, bool) and kind is not bool:
            raise ValueError
        if kind is int and isinstance(value, float) and not value.is_integer():
            raise ValueError
        if isinstance(value, str) or (isinstance(value, int | float) and kind in (int, float, bool)):
            return kind(value)
    except (ValueError, KeyError, OverflowError):
        pass
    raise ConfigError(f"{name} must be of type {kind.__name__}, got '{_short(value)}'")


def _short(value: Any) -> str:
    """What a message says of a value. Python does not write out integers of more than 4300 digits."""
    try:
        text = str(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


LARGEST = 2**31 - 1  # what OpenCV takes for a number, a seed for instance

# Fields that cost memory or time by their square, or with each polygon: far beyond any use, and within any machine.
MOST = {
    "segment.grid": 1000,
    "points.max_keypoints": 1_000_000,
    "global_match.max_layers": 100,
    "global_match.factor": 10,
    "global_match.phi": 63,
    "global_match.tau": 200,
    "local_match.neighbors": 10_000,
    "local_match.patch": 256,
    "tiles.size": 32_768,
    "pose.crop_size": 4096,
    "pose.crop_points": 100_000,
    "pose.max_crops": 10_000,
    "cloud.halvings": 60,
    "cloud.neighbors": 10_000,
}

SHARES = (
    "segment.min_predicted_iou",
    "segment.min_stability",
    "segment.nms_iou",
    "segment.max_area",
    "local_match.min_overlap",
    "points.min_score",
    "guided.min_overlap",
    "guided.min_predicted_iou",
    "guided.min_stability",
    "guided.min_match_overlap",
    "cloud.min_scale",
    "cloud.min_overlap",
    "cloud.same",
)

# Bytes that a process which matches one pair takes at its peak, each rounded up (`zpm2.estimate`). Measured as the
# largest resident set of fresh processes of `zpm2 match --tiles off`, Linux, two cores, OpenVINO, the scene of `zpm2
# demo` enlarged. Of photographs of 1, 4, 12 and 25 megapixels each, in MiB: preset default 1775, 1833, 2019, 2449;
# preset paper 1474, 1488, 1588, 2115; and of 100 megapixels with a fourth of its prompts 4125. Scenes differ in the
# number of large regions: "full" allows for a pair of 200 megapixels that was reported to take 20.7 GB (preset paper).
MEMORY = {
    "program": 0.6e9,  # what is loaded before any network, and the result
    "pixel": 25.0,  # for each pixel of both photographs
    "full": 25.0,  # the same, more where segment.quality is full
    "tiles": 0.5e9,  # what is kept from one tile to the next, and the cache of blocks (docs/results.md: 2.5 GB in all)
    # networks that segment, while they work; all but mobile_sam by the size of their weights, not measured
    "mobile_sam": 1.4e9,
    "vit_b": 3e9,
    "vit_l": 5e9,
    "vit_h": 8e9,
}

# The same, of point matchers for each pixel of the larger photograph as they see it, measured at 1.4 (xfeat: 12) and
# for SIFT 12 megapixels; superpoint is as aliked.
POINT_MEMORY = {
    "sift": 240.0,
    "xfeat": 140.0,
    "xfeat-dense": 140.0,
    "disk": 2600.0,
    "aliked": 2000.0,
    "aliked-n16rot": 2000.0,
    "aliked-n32": 2000.0,
    "superpoint": 2000.0,
}

# What the command line and `zpm2.match` call the fields that are set most often.
OPTIONS = {
    "segmenter": "segment.model",
    "quality": "segment.quality",
    "points": "points.methods",
    "tiles": "tiles.mode",
    "bands": "raster.bands",
    "gsd": "raster.gsd",
    "min_area_m2": "raster.min_area_m2",
    "estimator": "pose.estimator",
    "device": "device",
    "max_memory": "max_memory",
    "seed": "seed",
}

PRESETS: dict[str, Config] = {
    "paper": Config(),
    "default": Config(
        segment=SegmentConfig(quality="fast"),
        points=PointsConfig(look_again=True),
        local_match=LocalConfig(shape="overlap", few_points=True, min_overlap=0.35),
        guided=GuidedConfig(direction="both"),
        tiles=TilesConfig(mode="auto"),
        pose=PoseConfig(estimator="auto", noise_px=0.75, points="all", crops="rectified", bucket=50),
        cloud=CloudConfig(diffusion="surface"),
    ),
}
