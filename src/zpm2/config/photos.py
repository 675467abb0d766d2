"""Photographs that are large, georeferenced, or of many bands."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from zpm2.config.fields import number, option, share
from zpm2.config.parse import overlay
from zpm2.errors import ConfigError


def _bands(name: str, value: Any) -> None:
    if len(value) not in (0, 1, 3) or min(value, default=1) < 1:
        raise ConfigError(f"{name} are one or three band numbers from 1 on, got {','.join(map(str, value))}")


def _gsd(name: str, value: Any) -> None:
    if len(value) > 2 or min(value, default=1) <= 0:
        raise ConfigError(f"{name} is one number of m per px above 0, or two (left, right)")


@dataclass(frozen=True)
class StretchConfig:
    """Photographs of more than 8 bit: which values become 0 and 255, and which mean no data without saying so."""

    low_percentile: float = number(0.5, "of the values; it becomes 0", unit="%", high=100, source="chosen")
    high_percentile: float = number(99.5, "of the values; it becomes 255", unit="%", high=100, source="chosen")
    fill_share: float = share(0.05, "of the pixels that have one value, from which on it is no data", source="chosen")
    fill_border_share: float = share(0.5, "the same, of the pixels along the border", source="chosen")
    picture_share: float = share(0.99, "of one value, from which on it is the picture itself", source="chosen")
    noticed_share: float = share(0.005, "of one value, below which it is not looked at", source="chosen")
    far_share: float = share(
        0.25, "of the range of all other values; a value farther away may mean no data: a warning", source="chosen"
    )


@dataclass(frozen=True)
class RasterConfig:
    """Georeferenced and many-band photographs (extra `geo`)."""

    bands: tuple[int, ...] = option(
        (), "one (grey) or three (R, G, B), from 1 on; none: those that the file says are colours", check=_bands
    )
    gsd: tuple[float, ...] = option(
        (), "on the ground per px, one or left and right; none: what the files say", unit="m", check=_gsd
    )
    min_area_m2: float = number(
        0.0, "on the ground; smaller polygons are left out, `segment.min_area` counts too", unit="m^2"
    )
    large_px: int = number(
        16_000_000,
        "pixels; a photograph with more is read by windows, and matched in tiles where `tiles.mode` is auto",
        source="chosen by the memory that whole photographs take, docs/large-format.md",
    )

    stretch: StretchConfig = field(default_factory=StretchConfig)

    @staticmethod
    def of_result(config: Mapping[str, Any]) -> "RasterConfig":
        """How the photographs of a saved result were read, by its configuration; the defaults where it lacks this."""
        stored = config.get("raster")
        values = stored if isinstance(stored, Mapping) else {}
        names = {item.name for item in dataclasses.fields(RasterConfig)} & values.keys()
        made: RasterConfig = overlay(RasterConfig(), {name: values[name] for name in names})
        return made


@dataclass(frozen=True)
class TilesConfig:
    """Large photographs, seen in overlapping tiles of several scales."""

    mode: Literal["off", "on", "auto"] = option("off", "auto: where one has more than `raster.large_px`, or is thin")
    size: int = number(
        2048,
        "side of the finest tiles; each level above has tiles three times as wide",
        unit="px",
        low=256,
        high=32_768,
    )
    overlap: float = share(0.125, "of a tile's side that neighbouring tiles have in common at least", high=0.5)
    outside: bool = option(True, "also segment what only one of the photographs shows")
