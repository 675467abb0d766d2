"""Which polygon is which: the odds of each candidate by its place and its shape, and one assignment over all."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import LinkConfig
from zpm2.global_match import Candidates
from zpm2.linking.fit import FREEDOM, Fit
from zpm2.linking.layer import Shapes
from zpm2.local_match.assignment import assign_optimal

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

DENSITY_NEIGHBORS = 10  # right polygons that tell how many there are per m^2 around a place
MOST = 50.0  # log-odds; beyond, a double cannot tell confidences apart

NOTHING = "no polygon of the other layer is at its place"
OUTSIDE = "outside of the other layer"
TAKEN = "its candidates are links of other polygons that fit them better"
UNLIKE = "the polygons at its place lie or look differently"
PART = "a part of a polygon of the other layer"


@dataclass(frozen=True, eq=False)
class Links:
    """Rows are those of `Shapes`. Each array has one entry for each link."""

    left: Rows
    right: Rows
    confidence: Array  # 0..1
    distance: Array  # m, between the left centre's place and the right centre
    same_shape: Array  # 0..1, IoU with the centres laid on each other
    unmatched: tuple[Mapping[int, str], Mapping[int, str]]  # left and right: row -> reason
    # left row -> the right polygons that it is divided into, and right row -> left polygons
    parts: tuple[Mapping[int, Sequence[int]], Mapping[int, Sequence[int]]]


def link_polygons(left: Shapes, right: Shapes, fit: Fit, config: LinkConfig) -> Links:
    """The links of the most probable assignment, each more probable than `config.min_confidence` against its polygons
    having no partner; for every other polygon the reason; and the parts of polygons that the other layer divides."""
    moved = _moved(left, fit)
    pairs = _candidates(moved, fit.places, right, config)
    distance = np.hypot(*(right.centers[pairs.right] - fit.places[pairs.left]).T)
    alike = _same_shape(moved[pairs.left], fit.places[pairs.left], right, pairs.right)
    overlap = _overlap(moved[pairs.left], right.shapes[pairs.right])
    odds = _log_odds(pairs, distance, alike, overlap, fit, right, config)
    even = float(np.log(config.min_confidence / (1 - config.min_confidence)))
    chosen = assign_optimal(pairs, MOST + 1 - odds, MOST + 1 - even)
    left_parts, right_parts = _parts(moved, right, config)
    return Links(
        pairs.left[chosen],
        pairs.right[chosen],
        _confidence(pairs, odds)[chosen],
        distance[chosen],
        alike[chosen],
        (
            _reasons(pairs.left, pairs.left[chosen], odds > even, fit.places, right.centers, right_parts, config),
            _reasons(pairs.right, pairs.right[chosen], odds > even, right.centers, fit.places, left_parts, config),
        ),
        (_divided(left_parts), _divided(right_parts)),
    )


def _moved(left: Shapes, fit: Fit) -> NDArray[np.object_]:
    """(n,) the left polygons at their places in the right layer."""
    count = shapely.get_num_coordinates(left.shapes)
    of_shape = np.repeat(np.arange(len(left)), count)
    matrix, coordinates = fit.similarity.matrix, shapely.get_coordinates(left.shapes)
    placed = (coordinates - left.centers[of_shape]) @ matrix.T + fit.places[of_shape]
    return np.asarray(shapely.set_coordinates(left.shapes.copy(), placed), object)


def _candidates(moved: NDArray[np.object_], places: Array, right: Shapes, config: LinkConfig) -> Candidates:
    """Pairs whose centres are within `max_distance`, or half the radius of a circle as large as the left polygon: large
    outlines are drawn less alike."""
    reach = np.maximum(config.max_distance, np.sqrt(np.asarray(shapely.area(moved)) / np.pi) / 2)
    found = cKDTree(right.centers).query_ball_point(places, reach, return_sorted=True)
    i = np.repeat(np.arange(len(places)), [len(each) for each in found])
    return Candidates.of(i, np.array([row for each in found for row in each], np.int64))


def _same_shape(moved: NDArray[np.object_], places: Array, right: Shapes, rows: Rows) -> Array:
    """(c,) IoU of each pair with the left centre laid on the right one."""
    off = right.centers[rows] - places
    of_shape = np.repeat(np.arange(len(moved)), shapely.get_num_coordinates(moved))
    laid = shapely.set_coordinates(moved.copy(), shapely.get_coordinates(moved) + off[of_shape])
    common = _common(laid, right.shapes[rows])
    return np.asarray(common / (shapely.area(laid) + right.areas[rows] - common))


def _common(first: NDArray[np.object_], second: NDArray[np.object_]) -> Array:
    """(c,) m^2 that both polygons of a pair cover."""
    try:
        return np.asarray(shapely.area(shapely.intersection(first, second)))
    except shapely.errors.GEOSException:  # moving rounds coordinates, so that rings of a few may cross
        return np.asarray(shapely.area(shapely.intersection(shapely.make_valid(first), shapely.make_valid(second))))


def _overlap(moved: NDArray[np.object_], right: NDArray[np.object_]) -> Array:
    """(c,) 0..1 of the smaller polygon of each pair inside the other one."""
    smaller = np.minimum(shapely.area(moved), shapely.area(right))
    return np.asarray(_common(moved, right) / np.maximum(smaller, 1e-12))


def _log_odds(
    pairs: Candidates, distance: Array, alike: Array, overlap: Array, fit: Fit, right: Shapes, config: LinkConfig
) -> Array:
    """(c,) log-odds that a pair is one thing, against the right polygon being there by chance.

    Centres of one thing are off by Student's distribution, others lie anywhere, as dense as the right polygons around,
    but two things hardly overlap. Outlines that are alike speak for a link, others less strongly against it.
    """
    of_one = (1 + (distance / fit.sigma) ** 2 / FREEDOM) ** -(FREEDOM / 2 + 1) / (2 * np.pi * fit.sigma**2)
    k = min(DENSITY_NEIGHBORS, len(right))
    around, of_pair = np.unique(pairs.left, return_inverse=True)
    away = cKDTree(right.centers).query(fit.places[around], [k])[0][:, 0]
    density = (k / (np.pi * np.maximum(away, config.tolerance) ** 2))[of_pair] * np.maximum(
        1 - overlap, config.overlapping
    )
    by_shape = np.maximum(config.by_shape * (alike - config.same_shape), -config.least_by_shape)
    prior = np.log(config.prior / (1 - config.prior)) if config.prior < 1 else MOST
    return np.asarray(np.clip(prior + np.log(of_one / density) + by_shape, -MOST, MOST))


def _confidence(pairs: Candidates, odds: Array) -> Array:
    """(c,) 0..1, the odds of each pair among all pairs of its two polygons, and that they have no partner."""
    weight = np.exp(odds)
    of_left, of_right = (np.bincount(rows, weight)[rows] for rows in (pairs.left, pairs.right))
    return np.asarray(weight / (1 + of_left + of_right - weight))


def _parts(moved: NDArray[np.object_], right: Shapes, config: LinkConfig) -> tuple[dict[int, Rows], dict[int, Rows]]:
    """Left row -> the right polygons that lie in it, and right row -> the left polygons that do."""
    i, j = shapely.STRtree(right.shapes).query(moved, predicate="intersects")
    common = _common(moved[i], right.shapes[j])
    areas = np.asarray(shapely.area(moved)), right.areas
    in_left = common >= config.part * areas[1][j]
    in_right = common >= config.part * areas[0][i]
    found = []
    for whole, part, inside, area in ((i, j, in_left, areas[0]), (j, i, in_right, areas[1])):
        covered = np.bincount(whole[inside], common[inside], len(area)) >= config.parts * area
        several = np.bincount(whole[inside], minlength=len(area)) >= 2
        rows = defaultdict(list)
        for k in np.flatnonzero(inside & (covered & several)[whole]):
            rows[int(whole[k])].append(int(part[k]))
        found.append({row: np.array(sorted(each), np.int64) for row, each in sorted(rows.items())})
    return found[0], found[1]


def _divided(parts: Mapping[int, Rows]) -> dict[int, list[int]]:
    return {row: each.tolist() for row, each in parts.items()}


def _reasons(
    candidates: Rows,
    linked: Rows,
    likely: NDArray[np.bool_],
    places: Array,
    others: Array,
    parts_in_others: Mapping[int, Rows],
    config: LinkConfig,
) -> dict[int, str]:
    """Row -> why it is not linked. `places` are where the polygons are, `others` those of the other layer."""
    state = np.full(len(places), NOTHING, object)
    state[np.isinf(cKDTree(others).query(places, distance_upper_bound=max(config.outside, 1e-9))[0])] = OUTSIDE
    state[candidates] = UNLIKE
    state[candidates[likely]] = TAKEN
    for rows in parts_in_others.values():
        state[rows] = PART
    free = np.ones(len(places), bool)
    free[linked] = False
    return {int(row): str(state[row]) for row in np.flatnonzero(free)}
