"""One shift and turn between two layers, by votes of pairs of polygons around a few places.

Each pair of a left and a right polygon of about one area votes, for each turn, for the shift that lays their centres on
each other. Where the layers show the same ground, one turn and shift gets far more votes than chance gives.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import poisson

from zpm2 import memory
from zpm2.config import LinkConfig
from zpm2.linking.layer import Shapes
from zpm2.linking.similarity import Similarity, rotation

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

STEP = 5.0  # by which the reach grows
BESIDE = 2  # bins of shift, and twice as many of turn, within which a vote is part of the best one
AROUND = 10  # bins of shift that tell how many votes chance gives
BYTES_PER_BIN = 32  # of memory, of a table of votes
FEWEST = 3  # polygons that can vote: two agree on any turn


@dataclass(frozen=True, eq=False)
class Vote:
    """The best shift and turn around a place."""

    similarity: Similarity
    radius: float  # m, around its centre, of the polygons that voted
    votes: int
    polygons: int  # that could vote
    chance: float  # 0..1, probability of as many votes somewhere, if the layers had nothing to do with each other
    second: int  # most votes for another shift and turn

    def doubt(self, config: LinkConfig) -> str | None:
        """Why the vote does not count; None where it does."""
        of = f"votes of {self.polygons} polygons around one place"
        if self.chance > config.chance:
            return (
                "no shift and turn lays enough polygons of one layer on those of the other: "
                f"at best {self.votes} {of}, which chance may do"
            )
        if self.second > config.max_second * self.votes:
            return (
                f"different shifts or turns fit about equally well ({self.votes} and {self.second} {of}): the "
                "polygons repeat, or the layers show different things"
            )
        return None


def votes(left: Shapes, right: Shapes, config: LinkConfig) -> Iterator[Vote]:
    """The best vote of each place, from near to far shifts."""
    trees = cKDTree(left.centers), cKDTree(right.centers)
    reach = config.reach
    while True:
        for rows in _seeds(left, right, trees, reach, config):
            vote = _vote(left, right, rows, trees[1], reach, config)
            if vote is not None:
                yield vote
        if reach >= config.max_reach:
            return
        reach = min(STEP * reach, config.max_reach)


def _seeds(
    left: Shapes, right: Shapes, trees: tuple[cKDTree, cKDTree], reach: float, config: LinkConfig
) -> Iterator[Rows]:
    """The left polygons around each of a few places where both layers are dense, the densest first."""
    near, _ = trees[1].query(left.centers, distance_upper_bound=reach)
    near_both = np.flatnonzero(np.isfinite(near))
    if len(near_both) < FEWEST:
        return
    k = min(config.seed_polygons, len(near_both), len(right))
    common = cKDTree(left.centers[near_both])
    spread = np.maximum(
        common.query(left.centers[near_both], [k])[0][:, 0], trees[1].query(left.centers[near_both], [k])[0][:, 0]
    )
    free = np.ones(len(near_both), bool)
    for _ in range(config.seeds):
        if not free.any():
            return
        seed = int(np.argmin(np.where(free, spread, np.inf)))
        place = left.centers[near_both[seed]]
        yield np.sort(near_both[common.query(place, np.arange(1, k + 1))[1]])
        free &= np.hypot(*(left.centers[near_both] - place).T) > spread[seed]


def _vote(left: Shapes, right: Shapes, rows: Rows, tree: cKDTree, reach: float, config: LinkConfig) -> Vote | None:
    """The best vote of some left polygons; None without pairs."""
    center = np.median(left.centers[rows], axis=0)
    here = left.centers[rows] - center
    radius = float(np.hypot(*here.T).max())
    i, j = _pairs(left, right, rows, tree, reach + radius * float(np.radians(config.max_turn)), config)
    if len(i) == 0:
        return None
    there, here = right.centers[j] - center, left.centers[i] - center
    bins = int(np.ceil(reach / config.tolerance))
    memory.refuse_above(
        BYTES_PER_BIN * (2.0 * bins) ** 2,
        f"the vote for a shift of up to {reach:g} m",
        "give a larger link.tolerance or a smaller link.max_reach",
    )
    step = float(np.degrees(config.tolerance / max(radius, config.tolerance)))
    turns = step * np.arange(-np.ceil(config.max_turn / step), np.ceil(config.max_turn / step) + 1)
    tops = [_top(_table(here @ rotation(turn).T, there, config.tolerance, bins)) for turn in turns]
    # of several turns with as many votes, the smallest
    t = min(range(len(turns)), key=lambda t: (-tops[t].votes, abs(turns[t]), turns[t]))
    best, second = tops[t], 0
    for other, top in enumerate(tops):
        same = abs(other - t) <= 2 * BESIDE and np.abs(np.subtract(top.bin, best.bin)).max() <= BESIDE
        second = max(second, top.second if same else top.votes)
    chance = min(1.0, float(poisson.sf(best.votes - 1, best.expected)) * len(turns) * (2 * bins - 1) ** 2)
    shift = (np.array([best.bin[1], best.bin[0]], np.float64) + 1 - bins) * config.tolerance
    similarity = Similarity(center, shift, float(turns[t]))
    return Vote(similarity, radius, best.votes, len(np.unique(i)), chance, second)


@dataclass(frozen=True)
class _Top:
    """The shift with the most votes at one turn."""

    votes: int
    bin: tuple[int, int]
    second: int  # most votes for another shift
    expected: float  # votes for a shift by chance: the mean of those around


def _top(table: NDArray[np.int64]) -> _Top:
    """The best bin of a table of votes, which is cleared around it."""
    y, x = divmod(int(table.argmax()), table.shape[1])
    votes = int(table[y, x])
    around = table[max(0, y - AROUND) : y + AROUND + 1, max(0, x - AROUND) : x + AROUND + 1]
    own = table[max(0, y - BESIDE) : y + BESIDE + 1, max(0, x - BESIDE) : x + BESIDE + 1]
    expected = float((around.sum() - own.sum()) / max(around.size - own.size, 1))
    own[:] = 0
    return _Top(votes, (y, x), int(table.max()), expected)


def _pairs(
    left: Shapes, right: Shapes, rows: Rows, tree: cKDTree, radius: float, config: LinkConfig
) -> tuple[Rows, Rows]:
    """Pairs of polygons of about one area within a radius; of many, those of every n-th left polygon."""
    count = tree.query_ball_point(left.centers[rows], radius, return_length=True)
    every = int(np.ceil(count.sum() / config.max_pairs)) or 1
    found = tree.query_ball_point(left.centers[rows[::every]], radius, return_sorted=True)
    i = np.repeat(rows[::every], [len(each) for each in found])
    j = np.array([row for each in found for row in each], np.int64)
    areas = np.stack([left.areas[i], right.areas[j]])
    alike = areas.min(0) >= config.min_area_ratio * areas.max(0)
    return i[alike], j[alike]


def _table(here: Array, there: Array, tolerance: float, bins: int) -> NDArray[np.int64]:
    """(2 bins - 1, 2 bins - 1) votes for each shift: those within a tolerance of it along both axes."""
    cell = np.floor((there - here) / tolerance).astype(np.int64) + bins
    x, y = cell[((cell >= 0) & (cell < 2 * bins)).all(1)].T
    counts = np.bincount(y * 2 * bins + x, minlength=4 * bins * bins).reshape(2 * bins, 2 * bins)
    return np.asarray(counts[1:, 1:] + counts[1:, :-1] + counts[:-1, 1:] + counts[:-1, :-1])
