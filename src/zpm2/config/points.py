"""Homologous points (paper 3.2)."""

from dataclasses import dataclass
from typing import Any

from zpm2.config.fields import number, option, share
from zpm2.errors import ConfigError


def _some(name: str, value: Any) -> None:
    if not all(value or ("",)):
        raise ConfigError(f"{name} is empty: name at least one, for example sift")


@dataclass(frozen=True)
class PointsConfig:
    """Homologous points (paper 3.2). Several matchers are combined, as the paper does."""

    methods: tuple[str, ...] = option(("xfeat",), "see zpm2.features.METHODS", check=_some)
    max_keypoints: int = number(4096, "per image and method", low=1, high=1_000_000)
    max_size: int = number(
        1600, "the longer image side given to learned detectors; points come back in original px", unit="px", low=32
    )
    min_score: float = share(0.1, "the matcher's own")
    rotated_retry: bool = option(False, "smaller and turned, where few points agree on one geometry")
