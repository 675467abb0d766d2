"""The similarity between two layers from all of their polygons, and the slow local variation that is left."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import binom

from zpm2.config import LinkConfig
from zpm2.errors import Failed
from zpm2.linking.layer import Shapes
from zpm2.linking.similarity import Similarity, Uncertainty, fitted
from zpm2.linking.vote import Vote, votes

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

FREEDOM = 3.0  # degrees of freedom of Student's distribution of residuals: some centres are far off
MEDIAN = float(np.sqrt(FREEDOM * (2 ** (2 / FREEDOM) - 1)))  # of their length in two dimensions, sigma 1
ROUNDS = 10  # of fits with one set of polygons; the estimate rests after four or five
GROWTH = 2.0  # of the radius around the first place
LOCAL_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the left polygons are in the right layer."""

    similarity: Similarity
    uncertainty: Uncertainty
    places: Array  # (n, 2) m, of the left centres: moved by the similarity and the local variation
    sigma: float  # m, standard deviation of a right centre around its place, along each axis


def first_fit(left: Shapes, right: Shapes, config: LinkConfig) -> Fit | Failed:
    """The fit from the first vote that counts and holds for all polygons; `Failed` with the reason of the best vote
    where there is none. Of polygons around one centre, only the largest counts."""
    (left, which), (right, _) = left.distinct(), right.distinct()
    best, reason = (
        0.0,
        f"no polygons of about one area lie within {config.max_reach:g} m of each other in the two layers",
    )
    for vote in votes(left, right, config):
        doubt = vote.doubt(config)
        if doubt is None:
            found = fit(left, right, vote, config)
            if not isinstance(found, Failed):
                return replace(found, places=found.places[which])
            doubt = str(found)
        if vote.votes / vote.polygons > best:
            best, reason = vote.votes / vote.polygons, doubt
    return Failed(reason)


def fit(left: Shapes, right: Shapes, vote: Vote, config: LinkConfig) -> Fit | Failed:
    """Nearest pairs, fitted again and again by Student's distribution, from around the vote's place outwards.

    `Failed` where the right centres do not gather at the places of left ones: then it was chance.
    """
    tree = cKDTree(right.centers)
    away = np.hypot(*(left.centers - vote.similarity.center).T)
    similarity, radius = vote.similarity, vote.radius
    while True:
        here = left.centers[away <= radius]
        similarity = _fitted(here, right.centers, similarity, config)
        if not _gather(similarity(here), tree, config):
            return Failed(
                "the polygons do not lie on each other in any shift and turn: the layers show different things"
            )
        if radius >= away.max():
            break
        radius = max(GROWTH * radius, config.tolerance)
    places = similarity(left.centers)
    i, j = nearest_pairs(places, right.centers, config.max_distance)
    sigma = _sigma(right.centers[j] - places[i], config)
    similarity = similarity.about(left.centers[i].mean(0))
    uncertainty = _uncertainty(left.centers[i] - similarity.center, similarity, sigma)
    for _ in range(LOCAL_ROUNDS):
        places = _locally_moved(similarity(left.centers), right.centers, i, j, config)
        i, j = nearest_pairs(places, right.centers, config.max_distance)
        sigma = _sigma(right.centers[j] - places[i], config)
    return Fit(similarity, uncertainty, places, sigma)


def _gather(places: Array, tree: cKDTree, config: LinkConfig) -> bool:
    """Whether right centres gather at places: of those within two tolerances, more lie within half a tolerance than
    chance puts there, a sixteenth."""
    near, around = (
        int(tree.query_ball_point(places, share * config.tolerance, return_length=True).sum()) for share in (0.5, 2.0)
    )
    return near >= config.gathered * around and float(binom.sf(near - 1, around, 1 / 16)) <= config.chance


def nearest_pairs(places: Array, centers: Array, reach: float) -> tuple[Rows, Rows]:
    """Rows of places and of right centres that are each other's nearest within `reach` m."""
    there, of_place = cKDTree(centers).query(places, distance_upper_bound=reach)
    _, of_center = cKDTree(places).query(centers, distance_upper_bound=reach)
    i = np.flatnonzero(np.isfinite(there))
    i = i[of_center[of_place[i]] == i]
    return i.astype(np.int64), of_place[i].astype(np.int64)


def _fitted(here: Array, centers: Array, start: Similarity, config: LinkConfig) -> Similarity:
    """The similarity of left centres to the right ones nearest to their places."""
    found = start
    for _ in range(ROUNDS):
        i, j = nearest_pairs(found(here), centers, 2 * config.tolerance)
        if len(i) < 2:
            return found
        off = centers[j] - found(here[i])
        weights = 1 / (1 + (off**2).sum(1) / (FREEDOM * _sigma(off, config) ** 2))
        found = fitted(here[i], centers[j], weights)
    return found


def _sigma(off: Array, config: LinkConfig) -> float:
    """Standard deviation along each axis of (n, 2) residuals, by their median length."""
    return max(config.min_sigma, float(np.median(np.hypot(*off.T))) / MEDIAN) if len(off) else config.tolerance


def _uncertainty(here: Array, similarity: Similarity, sigma: float) -> Uncertainty:
    """Of n pairs whose left centres lie at `here` around the similarity's centre."""
    n, spread = max(len(here), 1), max(float((here**2).sum()), 1e-12)
    of_angle = sigma / np.sqrt(spread)  # radians, and of the scale
    return Uncertainty(
        sigma / float(np.sqrt(n)), float(np.degrees(of_angle / similarity.scale)), float(of_angle), sigma
    )


def _locally_moved(places: Array, centers: Array, i: Rows, j: Rows, config: LinkConfig) -> Array:
    """Places moved by the median residual of the nearest pairs around each of them, its own left out.

    A place with fewer pairs around it than half of those that are asked for stays where it is.
    """
    if len(i) == 0:
        return places
    k = min(config.local_pairs + 1, len(i))
    away, near = cKDTree(places[i]).query(places, np.arange(1, k + 1), distance_upper_bound=config.local_radius)
    known = np.isfinite(away)
    off = np.concatenate([centers[j] - places[i], np.full((1, 2), np.nan)])
    pair_of = np.full(len(places), -1)
    pair_of[i] = np.arange(len(i))
    known &= near != pair_of[:, None]
    enough = known.sum(1) >= max(1, config.local_pairs // 2)
    moved = places.copy()
    moved[enough] += np.nanmedian(off[np.where(known[enough], near[enough], len(i))], axis=1)
    return moved
