"""What became of a region: its status, how much of it is visible, how sure that is, and the reason in words."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from zpm2.config import CarryConfig
from zpm2.formats.regions.region import Shape

Status = Literal["found", "in part", "outside", "hidden", "not found"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """One given region in the right photograph."""

    status: Status
    reason: str
    shape: Shape | None  # right px; None where it is not seen
    confidence: float  # 0..1, that the outline covers the region by IoU 0.5; 0 without one
    visible: float | None  # 0..1, share of the region that is seen; None: unknown
    agreement: float = 0.0  # 0..1, soft IoU with what was expected
    trust: float = 0.0  # 0..1, in the place by points
    points: int = 0  # homologous points in the region that agree on it
    place: tuple[float, float] | None = None  # px, where its centre is, or should be
    sigma: float | None = None  # px, standard deviation of that place along each axis
    alternatives: tuple[tuple[float, float, float], ...] = ()  # x, y, agreement of other places
    pair_points: int = 0  # homologous points of the whole pair that agree on one geometry
    surrounded: float = 0.0  # 0..1, share of the region, on the left, that lies among these


def confidence(agreement: float, trust: float, points: int, surrounded: float, config: CarryConfig) -> float:
    """0..1 from the agreement of an answer, the trust in its place, the points of the pair that agree on one geometry,
    and the share of the region among these (a logistic model)."""
    evidence = config.by_agreement * agreement + config.by_trust * trust - config.intercept
    evidence += config.by_points * points / (points + config.many_points) + config.by_surrounded * surrounded
    return float(1 / (1 + np.exp(-evidence)))


def inside_share(shape: shapely.Geometry, size: tuple[int, int]) -> float:
    """0..1 of a shape, px, within a photograph of `size` (width, height) px."""
    if shape.is_empty:
        return 0.0
    return float(shape.intersection(shapely.box(0, 0, *size)).area / shape.area)


def is_outside(place: shapely.Geometry, trust: float, size: tuple[int, int], config: CarryConfig) -> bool:
    """Whether points say that a place is not within a photograph of `size` (width, height) px."""
    return trust >= config.min_trust and not place.is_empty and inside_share(place, size) < config.outside


def missing(
    place: shapely.Geometry, trust: float, size: tuple[int, int], lost: str | None, config: CarryConfig
) -> tuple[Status, str]:
    """Status and reason of a region for which no answer was good enough; `lost` names the one that took its place."""
    if is_outside(place, trust, size, config):
        return "outside", "its place by the points around is outside of the photograph"
    if lost is not None:
        return "not found", f"region {lost} fits its only place better"
    if trust >= config.trusted:
        return "hidden", "its place is in the photograph, and nothing there has its outline: hidden, changed or gone"
    if trust >= config.min_trust:
        return "not found", "few points tell its place, and nothing there has its outline"
    return "not found", "no points tell its place, and nothing looks enough like it"


def found(
    visible: float | None,
    place: shapely.Geometry,
    trust: float,
    moved: bool,
    size: tuple[int, int],
    config: CarryConfig,
) -> tuple[Status, str]:
    """Status and reason of a region with an outline; `moved`: its own one, at its place."""
    by = "points and outline agree" if trust >= config.min_trust else "it looks like the region"
    by = "points tell its place: outline moved, not snapped" if moved else by
    if visible is None or visible >= config.whole:
        return "found", by
    cut = trust >= config.trusted and inside_share(place, size) < config.whole
    why = "cut by the border" if cut else "partly hidden, or seen from the side"
    return "in part", f"{visible:.0%} of it is visible: {why}" + ("; outline moved, not snapped" if moved else "")
