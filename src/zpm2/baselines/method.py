"""What a method of matching is, and what it may look at: a protocol, its input and its output."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2.config.fields import check, rule_of
from zpm2.local_match.shared_points import SharedPoints, shared_points
from zpm2.model import Image, PointMatches, PolygonArrays
from zpm2.runtime import StageTimer

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Shapes = NDArray[np.object_]  # (n,) shapely polygons or multipolygons, image px
T = TypeVar("T")
Both = tuple[T, T]  # of the left and of the right image


@dataclass(frozen=True, eq=False)
class RegionPair:
    """The regions of a pair, and what lies in them. Row k of everything belongs to polygon k of that side.

    `points` are empty for a method that does not ask for them.
    """

    images: Both[Image]
    polygons: Both[PolygonArrays]
    points: PointMatches
    embed: Callable[[Both[Shapes]], Both[Array]]  # see `embeddings.Encoder.embed`
    seed: int = 0  # of what is random: robust estimates

    @cached_property
    def shared(self) -> SharedPoints:
        """The homologous points inside both of two polygons, for each pair of polygons that has any."""
        return shared_points(self.points, *self.polygons)


@dataclass(frozen=True, eq=False)
class Pairing:
    """The matches of a method: each polygon at most once."""

    rows: Rows  # (k, 2) rows of the left and of the right polygon
    cost: Array  # (k,) the method's own cost, the smaller the better
    confidence: Array  # (k,) 0..1: ranks the matches of one method, and is no probability

    @staticmethod
    def none() -> "Pairing":
        """No match."""
        return Pairing(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0))


class Method(Protocol):
    """A way to match the regions of a pair. Its settings are the fields of a frozen dataclass."""

    name: ClassVar[str]  # what `--method` calls it
    uses_points: ClassVar[bool]  # whether homologous points are looked for
    notes: ClassVar[tuple[str, ...]]  # told with every result: whose method it is, and what was left out

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """The matches. What takes long runs inside `stage(NAME)`, which measures it and reports its progress."""
        ...


class Checked:
    """A dataclass whose fields were declared by `config.fields`: values out of range raise `ConfigError`."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):  # type: ignore[arg-type]  # of each class that derives from this one
            check(f"{self.name}: {item.name}", getattr(self, item.name), rule_of(item))


def mutual_best(pairs: Rows, score: Array) -> NDArray[np.int64]:
    """(b,) rows of the (p, 2) pairs that are the best of both of their polygons by (p,) score. Of equally good ones
    the first counts."""
    order = np.argsort(-score, kind="stable")
    left, right = (order[np.unique(pairs[order, side], return_index=True)[1]] for side in (0, 1))
    return np.asarray(np.intersect1d(left, right), np.int64)


def greedy(pairs: Rows, score: Array) -> NDArray[np.int64]:
    """(b,) rows of the (p, 2) pairs that are left when the best by (p,) score is taken again and again, and with it all
    that share a polygon with it."""
    taken: tuple[set[int], set[int]] = set(), set()
    kept = []
    for row in np.argsort(-score, kind="stable").tolist():
        i, j = pairs[row].tolist()
        if i not in taken[0] and j not in taken[1]:
            taken[0].add(i)
            taken[1].add(j)
            kept.append(row)
    return np.array(sorted(kept), np.int64)
