"""A polygon correspondence."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zpm2.model.brief import brief
from zpm2.model.image_polygons import SideName

Stage = Literal["global", "local", "guided"]


@dataclass(frozen=True, eq=False)
class PolygonMatch:
    """Polygon `left` of the left image is polygon `right` of the right image."""

    left: int  # id
    right: int  # id
    confidence: float  # 0..1, chance that the two overlap by more than half (see `verify`); 0: not verified
    cost: float  # zeta of Eq. (cost), > 0
    dsf: int  # chi: homologous points inside both polygons
    stage: Stage  # which stage brought the pair in
    overlap: float = 0.0  # 0..1, IoU of the rectified left polygon with the right one
    nodes: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    # (k, 2) homologous vertices: row (a, b) says that exterior vertex a of `left` is exterior vertex b of `right`
    outline: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 5)))
    # (k, 5) homologous points all around the exteriors: x_left, y_left, x_right, y_right, residual, px; empty unless
    # asked for (see `local_match.outline`)
    visible: float = 1.0  # 0..1, share of either polygon, the smaller one, that both photographs can show

    __repr__ = brief

    @property
    def id(self) -> int:
        """What every file and picture calls this match: the id of its left polygon, which no other match has."""
        return self.left


@dataclass(frozen=True)
class Counterpart:
    """What the files of one image say about the match of one of its polygons."""

    match_id: int  # `PolygonMatch.id`
    polygon_id: int  # of the partner in the other image
    confidence: float  # 0..1


def counterparts(matches: Iterable[PolygonMatch], side: SideName) -> dict[int, Counterpart]:
    """By the id of each matched polygon of one side."""
    other = "right" if side == "left" else "left"
    return {getattr(m, side): Counterpart(m.id, getattr(m, other), m.confidence) for m in matches}
