"""Regions compete for places: one assignment over all, and no pixel for two that shared none."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.carry.asking import Answers
from zpm2.config import CarryConfig
from zpm2.formats.regions.outlines import joined
from zpm2.formats.regions.region import Shape
from zpm2.global_match import Candidates
from zpm2.local_match.assignment import assign_optimal
from zpm2.polygons.overlap import iou
from zpm2.polygons.repair import polygons_in
from zpm2.segment.suppression import boxes, leaders, pack

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Choice:
    """The answer that a region got, and those that it might have got elsewhere."""

    row: int | None  # of its `Answers`; None: it got no place
    others: tuple[int, ...]  # rows of answers at other places, the best first
    lost: int | None  # the region that took its best place, where there is one


def decide(answers: Sequence[Answers], given: NDArray[np.object_], config: CarryConfig) -> list[Choice]:
    """The answer of each of the (n,) `given` regions, left px: the sum of agreements is the largest, and no place
    is taken twice.

    Masks that overlap by `config.same_place` (IoU) are one place, whoever asked for them. Regions that overlap as much
    on the left are one place there, and share their place on the right.
    """
    region = np.repeat(np.arange(len(answers)), [len(each.agreement) for each in answers])
    row = np.concatenate([np.arange(len(each.agreement)) for each in answers] or [np.zeros(0, np.intp)])
    agreement = np.concatenate([each.agreement for each in answers] or [np.zeros(0)])
    good = agreement >= config.min_agreement
    region, row, agreement = region[good], row[good], agreement[good]
    if not len(region):
        return [Choice(None, (), None)] * len(answers)
    bits = np.concatenate([each.masks.bits[each.agreement >= config.min_agreement] for each in answers])
    areas = np.count_nonzero(bits, axis=(1, 2))
    place = leaders(pack(bits), boxes(bits), areas, agreement, config.same_place)
    order = np.lexsort((-agreement, place, region))
    _, first = np.unique(np.c_[region, place][order], axis=0, return_index=True)
    best = order[first]  # of each region at each place, sorted by both
    region, row, agreement, place = region[best], row[best], agreement[best], place[best]
    cost = 1 - agreement
    chosen = assign_optimal(Candidates(region, place), cost, 1 - config.min_agreement + 1e-9)
    winner = np.full(place.max() + 1, -1)
    winner[place[chosen]] = region[chosen]
    found = []
    for k in range(len(answers)):
        mine = np.flatnonzero(region == k)
        mine = mine[np.argsort(-agreement[mine], kind="stable")]
        own = mine[np.isin(mine, chosen)]
        taken_by = int(winner[place[mine[0]]]) if len(mine) else -1
        lost = taken_by if taken_by not in (-1, k) else None
        if lost is not None and iou(given[[k]], given[[lost]])[0] >= config.same_place:
            own, lost = mine[:1], None
        elsewhere = tuple(int(row[m]) for m in mine if m not in own)
        found.append(Choice(int(row[own[0]]) if len(own) else None, elsewhere, lost))
    return found


def disjoint(
    shapes: NDArray[np.object_],
    given: NDArray[np.object_],
    places: NDArray[np.object_],
    agreement: Array,
    config: CarryConfig,
) -> NDArray[np.object_]:
    """(n,) the found shapes, right px, without what two of them share although the `given` ones, left px, did not.

    What is contested goes to the region whose place (n,), right px or empty, it is in, and what is in none or in both
    to the one with the higher `agreement` (n,).
    """
    found = shapes.copy()
    i, j = shapely.STRtree(found).query(found, predicate="intersects")
    pairs = np.c_[i, j][i < j]
    common = shapely.area(shapely.intersection(given[pairs[:, 0]], given[pairs[:, 1]]))
    smaller = np.minimum(shapely.area(given[pairs[:, 0]]), shapely.area(given[pairs[:, 1]]))
    for a, b in pairs[common <= config.max_shared * smaller].tolist():
        first, second = (a, b) if agreement[a] >= agreement[b] else (b, a)
        contested = _areas(found[first].intersection(found[second]))
        if contested.is_empty:
            continue
        of_second = _areas(contested.intersection(_areas(places[second].difference(places[first]))))
        found[first] = _areas(found[first].difference(of_second))
        found[second] = _areas(found[second].difference(_areas(contested.difference(of_second))))
    return found


def _areas(shape: shapely.Geometry) -> Shape:
    """The polygons of a shape, without lines and points."""
    return joined(polygons_in(shape)) or shapely.Polygon()
