"""Homologous points (paper 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from zpm2.config.fields import Word, number, option, options, share
from zpm2.config.robust import MagsacConfig
from zpm2.errors import ConfigError

RETRY = "measured, docs/points.md"


def _some(name: str, value: tuple[str, ...]) -> None:
    if not all(value or ("",)):
        raise ConfigError(f"{name} is empty: name at least one, for example sift")


def _half_turns(name: str, value: tuple[int, ...]) -> None:
    if any(angle > 180 for angle in value):
        raise ConfigError(f"{name} are turns from 0 to 180 degrees, got {','.join(map(str, value))}")


def _sides(name: str, value: tuple[int, ...]) -> None:
    if not value or min(value) < 32:
        raise ConfigError(f"{name} are one or more sides of at least 32 px, got {','.join(map(str, value))}")


@dataclass(frozen=True)
class RotatedRetryConfig:
    """When and how a pair is searched again, smaller and turned (`points.rotated_retry`)."""

    min_points: int = number(
        200, "fewer that agree on one epipolar geometry: the first round, by `turns`", low=1, source=RETRY
    )
    min_points_far: int = number(100, "fewer after it: the second round, by `far_turns`", low=1, source=RETRY)
    enough_points: int = number(
        1000,
        "that many matches, whether they agree or not: no more rounds",
        low=1,
        source="true points of a pair that matches at all number hundreds",
    )
    turns: tuple[int, ...] = option(
        (0, 45),
        "of the right image to either side, first round",
        unit="degrees",
        check=_half_turns,
        source="learned points stand about 20 degrees: 45 to either side reach 65",
    )
    far_turns: tuple[int, ...] = option(
        (90, 135, 180),
        "the same, second round",
        unit="degrees",
        check=_half_turns,
        source="the remaining turns, in the same steps",
    )
    sizes: tuple[int, ...] = option(
        (640, 1000),
        "longer sides at which both images are searched",
        unit="px",
        check=_sides,
        source="a motion blur of some px is gone at the smaller one",
    )
    max_keypoints: int = number(
        2048,
        "per image, method and search",
        low=1,
        high=1_000_000,
        source="half of points.max_keypoints, as the images are smaller",
    )
    noise_px: float = number(
        3.0,
        "threshold of the epipolar geometry; more where images were reduced to max_size",
        unit="px",
        above=True,
        source="as global_match.epipolar_px",
    )
    merge_px: float = number(
        2.0,
        "matches of two searches that are closer in both images are one",
        unit="px",
        source="the noise of points of images that are reduced to half",
    )
    magsac: MagsacConfig = field(default_factory=MagsacConfig)


@dataclass(frozen=True)
class PointsConfig:
    """Homologous points (paper 3.2). Several matchers are combined, as the paper does."""

    methods: tuple[str, ...] = option(
        ("xfeat",), "one or several (zpm2 models), or package.module:Class, see docs/points.md", check=_some
    )
    options: Mapping[str, Word] = options("of these matchers; each goes to those that have it")
    max_keypoints: int = number(4096, "per image and method", low=1, high=1_000_000, source="as published for XFeat")
    max_size: int = number(
        1600,
        "the longer image side given to learned detectors; points come back in original px",
        unit="px",
        low=32,
        source="time and memory grow with the area; finer detail seldom repeats",
    )
    min_score: float = share(0.1, "the matcher's own", source="as published for LightGlue")
    merge_px: float = number(
        1.0, "matches of two methods that are closer in both images are one", unit="px", source="the noise of a point"
    )
    trained_size: bool = option(
        True, "no larger than the size that a matcher was trained for, where one is known (zpm2 models)"
    )
    blank_window: int = number(
        17,
        "side of the square around a learned point that must show some contrast",
        unit="px",
        low=1,
        high=255,
        odd=True,
        source="8 px to either side, a cell of the networks",
    )
    blank_range: int = number(
        1,
        "largest range of such a square that counts as blank",
        unit="grey levels",
        high=255,
        source="rounding of a constant value",
    )
    sift_ratio: float = share(
        0.8, "largest ratio of the nearest to the second nearest distance", source="Lowe, IJCV 2004"
    )
    sift_contrast: float = number(
        0.01,
        "contrast threshold of SIFT",
        source="measured, docs/points.md; 0.04 of OpenCV finds nothing on plain walls",
    )
    aliked_threshold: float = share(
        0.05, "score from which ALIKED takes a point", source="measured, docs/points.md; published 0.2"
    )
    superpoint_threshold: float = share(
        0.0005, "probability from which SuperPoint takes a point", source="that of LightGlue; published 0.015"
    )
    loftr_threshold: float = share(
        0.2, "confidence from which LoFTR and Efficient LoFTR take a pair of cells", source="published"
    )
    rotated_retry: bool = option(False, "smaller and turned, where few points agree on one geometry")
    retry: RotatedRetryConfig = field(default_factory=RotatedRetryConfig)

    def side(self, trained: int) -> int:
        """Px, the longer image side given to a matcher that was trained for `trained` px (0: for any size)."""
        return min(self.max_size, trained) if trained and self.trained_size else self.max_size
