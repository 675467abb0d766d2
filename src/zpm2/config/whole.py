"""The whole configuration as one value: compare it, print it, write it to a file and read it back."""

import dataclasses
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from zpm2 import memory
from zpm2.config.carry import CarryConfig
from zpm2.config.cloud import CloudConfig
from zpm2.config.fields import check, number, option, rule_of
from zpm2.config.global_match import GlobalConfig
from zpm2.config.link import LinkConfig
from zpm2.config.local_match import GuidedConfig, LocalConfig
from zpm2.config.parse import check_type, overlay
from zpm2.config.photos import RasterConfig, TilesConfig
from zpm2.config.points import PointsConfig
from zpm2.config.pose import PoseConfig
from zpm2.config.reconstruct import ReconstructConfig
from zpm2.config.segment import SegmentConfig, VectorizeConfig
from zpm2.config.stereo import StereoConfig
from zpm2.config.tracks import TracksConfig
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def _known_size(name: str, value: str) -> None:
    if value != memory.AUTO:
        memory.size(value)


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
    stereo: StereoConfig = field(default_factory=StereoConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    carry: CarryConfig = field(default_factory=CarryConfig)
    link: LinkConfig = field(default_factory=LinkConfig)
    tracks: TracksConfig = field(default_factory=TracksConfig)
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)
    seed: int = number(0, "of everything random")
    device: str = option("auto", "auto, cpu, cuda")
    max_memory: str = option(
        memory.AUTO, "8GB, 512MB, ...; auto: 80 % of what is free; none: no limit", check=_known_size
    )

    def __post_init__(self) -> None:
        for name, item, value in _fields(self):
            check_type(name, value, item.type)
            check(name, value, rule_of(item))

    def check_together(self) -> None:
        """`ConfigError` for values that are good each, and not together. `--set` may pass through such."""
        phi, window = self.global_match.phi, 2 * self.global_match.tau
        if phi > window:
            raise ConfigError(
                f"global_match.phi={phi} is wider than the search window of 2 x global_match.tau={window} px: give a "
                "smaller phi, or a larger tau"
            )

    def to_dict(self) -> dict[str, object]:
        """Plain nested dictionaries, as in `matches.json`."""
        return dataclasses.asdict(self)

    @staticmethod
    def from_dict(values: Mapping[str, object], base: "Config | None" = None) -> "Config":
        """`base` (else the defaults) with `values` laid over it. Unknown names and wrong types raise `ConfigError`."""
        return overlay(base or Config(), values)


def choices(key: str) -> tuple[str, ...]:
    """The values that a "stage.field" may have, where they are words that can be told; else none."""
    kind = _kind(key)
    return typing.get_args(kind) if typing.get_origin(kind) is Literal else ()


def describe(config: Config) -> Iterator[tuple[str, str, object, str]]:
    """Of every field "stage.field", its type, its value in `config`, and its unit and meaning."""
    for name, item, value in _fields(config):
        yield name, _type_name(_kind(name)), value, str(rule_of(item))


def _fields(
    holder: "DataclassInstance | type[DataclassInstance]", where: str = ""
) -> Iterator[tuple[str, "dataclasses.Field[object]", object]]:
    """Each "stage.field" with its declaration and its value, those of stages within stages too."""
    for item in dataclasses.fields(holder):
        value = getattr(holder, item.name)
        if dataclasses.is_dataclass(value) and isinstance(value, typing.cast(type, item.type)):
            yield from _fields(value, f"{where}{item.name}.")
        else:
            yield f"{where}{item.name}", item, value


def _kind(key: str) -> object:
    kind: object = Config
    for part in key.split("."):
        kind = typing.get_type_hints(kind)[part]
    return kind


def _type_name(kind: object) -> str:
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is Literal:
        return " | ".join(arguments)
    if typing.get_origin(kind) is tuple:
        return f"{_type_name(arguments[0])},..."
    if typing.get_origin(kind) is Mapping:
        return "NAME=VALUE"
    assert isinstance(kind, type)
    return kind.__name__
