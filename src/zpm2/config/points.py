"""Homologous points (paper 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from zpm2.config.fields import Word, number, option, options, share
from zpm2.errors import ConfigError


def _some(name: str, value: tuple[str, ...]) -> None:
    if not all(value or ("",)):
        raise ConfigError(f"{name} is empty: name at least one, for example sift")


OWN = "own"  # in `EscalateConfig.searches`: the matchers of `PointsConfig.methods`


def _turns(name: str, value: tuple[int, ...]) -> None:
    if not value or max(value) >= 360:
        raise ConfigError(f"{name} are one or more turns from 0 to 359 degrees, got {','.join(map(str, value))}")


def parts_of_search(search: str) -> tuple[str, int]:
    """Method and side (px) of a search of `EscalateConfig.searches`.

    >>> parts_of_search("aliked@640")
    ('aliked', 640)
    """
    method, _, side = search.rpartition("@")
    return method, int(side)


def _searches(name: str, value: tuple[str, ...]) -> None:
    for search in value:
        method, _, side = search.rpartition("@")
        if not method or not side.isdecimal() or int(side) < 32:
            raise ConfigError(f"{name} are searches like xfeat@640, with sides of at least 32 px, got '{search}'")


@dataclass(frozen=True)
class CoarseConfig:
    """How the turn and the zoom between two photographs are found, before they are searched again
    (`points.escalate.coarse`)."""

    sift_size: int = number(
        800,
        "longer side at which SIFT compares both photographs",
        unit="px",
        low=32,
        source="a quarter of a second; SIFT needs detail",
    )
    sift_keypoints: int = number(2048, "of SIFT, per view", low=8, high=1_000_000, source="time")
    size: int = number(
        480,
        "longer side at which XFeat and ALIKED do",
        unit="px",
        low=32,
        source="the whole pass takes a second of CPU",
    )
    max_keypoints: int = number(
        512,
        "of XFeat and ALIKED, per view",
        low=8,
        high=1_000_000,
        source="time; a turn needs tens of points, not hundreds",
    )
    turns: tuple[int, ...] = option(
        (0, 45, 90, 135, 180, 225, 270, 315),
        "of the right photograph, in which XFeat looks",
        unit="degrees",
        check=_turns,
        source="learned points stand about 20 degrees",
    )
    aliked_turns: tuple[int, ...] = option(
        (0, 90, 180, 270),
        "the same of ALIKED, which looks where the others find nothing",
        unit="degrees",
        check=_turns,
        source="it stands 40 degrees, measured, docs/points.md",
    )
    zoom: float = number(
        3.0,
        "that XFeat tries last, either photograph reduced by it",
        low=1.0,
        source="learned points stand a zoom of about 1.7: 3 reaches 5",
    )
    reach: float = share(
        0.05,
        "of the longer side of the right photograph, that points may be off a similarity",
        above=True,
        source="relief and perspective, which a similarity lacks; SIFT uses a quarter (Lowe, IJCV 2004)",
    )
    significance: float = number(
        8.0,
        "a similarity is a hint if at most 10 to the power of minus this many as good ones are expected by chance",
        unit="decades",
        source="as global_match.chance.significance",
    )
    min_turn: float = number(
        15.0, "smaller turns are left as they are", unit="degrees", source="learned points stand about 20 degrees"
    )
    same_zoom: float = number(
        1.4, "hints whose zooms differ by less are alike", low=1, source="learned points stand about 1.7"
    )
    rival_share: float = share(
        0.5, "of the best hint's decades from which another hint is tried too", source="measured, docs/points.md"
    )


@dataclass(frozen=True)
class EscalateConfig:
    """When and how a pair is searched again (`points.escalate`, docs/points.md)."""

    on: bool = option(False, "search again where the geometry is not safe")
    safe_chance: float = number(
        200.0,
        "safe: at most 10 to the power of minus this many geometries as good are expected by chance",
        unit="decades",
        source="measured, docs/points.md",
    )
    safe_points: int = number(200, "safe: that many points agree on the geometry", source="measured, docs/points.md")
    safe_share: float = share(0.4, "safe: that share of all points agrees", source="measured, docs/points.md")
    safe_cells: int = number(
        10,
        "safe: they lie in that many of 8 x 8 cells, in both photographs",
        high=64,
        source="a sixth of the view; points on one object say little of the rest",
    )
    coarse: CoarseConfig = field(default_factory=CoarseConfig)
    searches: tuple[str, ...] = option(
        ("own@720", "aliked@720", "own@1000", "aliked@900"),
        "one after the other until the geometry is safe: METHOD@PX, own are those of points.methods; a "
        "view has at most PX x PX pixels",
        check=_searches,
        source="measured, docs/points.md: the cheapest first",
    )
    max_looks: int = number(
        6, "searches at most, those at several turns counted each", low=1, source="10 s on two cores, docs/points.md"
    )
    max_looks_without_hint: int = number(
        2,
        "the same where the coarse pass found nothing",
        low=1,
        source="such photographs mostly show two scenes, docs/points.md",
    )
    max_keypoints: int = number(
        2048,
        "per view",
        low=1,
        high=1_000_000,
        source="half of points.max_keypoints, as the views are smaller",
    )
    merge_px: float = number(
        2.0,
        "matches of two searches that are closer in both images are one",
        unit="px",
        source="the noise of points of images that are reduced to half",
    )


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
    escalate: EscalateConfig = field(default_factory=EscalateConfig)

    def side(self, trained: int) -> int:
        """Px, the longer image side given to a matcher that was trained for `trained` px (0: for any size)."""
        return min(self.max_size, trained) if trained and self.trained_size else self.max_size
