"""The evidence of a match that did not make it.

Candidates are found by where a polygon should be, and assigned by the overlap of outlines, the number of points in both
and a resampled patch. None of these is asked again as it was. Instead: the insides, rectified by the outlines alone
(`content`), and by a dense flow without them (`flow`); the points that lie in only one of both polygons; and how the
neighbours moved.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2 import geometry
from zpm2.config import LocalConfig, VerifyConfig
from zpm2.global_match import Candidates
from zpm2.local_match import MatchProblem, texture
from zpm2.local_match.pair_map import by_areas
from zpm2.local_match.shared_points import shared_points
from zpm2.model import PolygonArrays
from zpm2.polygons.once import each_once, identity, vertices
from zpm2.polygons.transform import transform_polygons
from zpm2.polygons.warp import warp_by_points
from zpm2.verify import content, flow

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known about k matches."""

    content: Array  # (k,) -2..2, how much better the insides correlate in place than shifted (`content.peaks`)
    texture: Array  # (k,) 0..1, correlation of the insides, each stretched to the same frame (R of the paper)
    agreement: Array  # (k,) 0..1, share of the points in either polygon that are in both
    motion: Array  # (k,) 0.., how far the polygon is from where its neighbours' motion takes it, in its own sides
    flow: Array  # (k,) 0..1, how much both overlap where a dense flow puts them, and how consistent it is
    width: Array  # (k,) px, 2 area / perimeter of the narrower polygon: an outline that is a px off costs it more


def gather(problem: MatchProblem, pairs: Candidates, others: Candidates, config: LocalConfig) -> Evidence:
    """The evidence of the matches `pairs` (rows of the polygons). `others` are the matches whose motion is compared
    with theirs; a match is not compared with itself."""
    left, right = (
        PolygonArrays([side.polygons[row] for row in rows])
        for side, rows in zip(problem.polygons, (pairs.left, pairs.right), strict=True)
    )
    linear = problem.locations.prior.linear[pairs.left]
    linear = np.where(_usable(linear)[:, None, None], linear, np.eye(2))
    in_place, stretched, flowing = _compared_once(problem, left, right, linear, config)
    moved = motion(problem, pairs, others, linear, config.verify)
    width = np.minimum(*(2 * side.areas / np.maximum(shapely.length(side.shapes), 1e-9) for side in (left, right)))
    each = np.arange(len(left))
    agreement = shared_points(problem.initial.forward()[0], left, right).agreement(Candidates(each, each))
    return Evidence(in_place, stretched, agreement, moved, flowing, width)


def motion(problem: MatchProblem, pairs: Candidates, others: Candidates, linear: Array, config: VerifyConfig) -> Array:
    """(k,) distance between each right polygon and where its neighbours take it, in sides sqrt(area) of that polygon.

    A neighbour takes it there by its own motion and the `linear` part (k, 2, 2) of the pair's geometry; of the
    `config.neighbors` nearest matches the median counts. `config.unknown_motion` with fewer than
    `config.min_neighbors`.
    """
    result = np.full(len(pairs), config.unknown_motion)
    if len(others) <= config.min_neighbors or not len(pairs):
        return result
    left, right = problem.polygons
    here, there = left.centers[pairs.left], right.centers[pairs.right]
    other_here, other_there = left.centers[others.left], right.centers[others.right]
    _, near = cKDTree(other_here).query(here, k=min(config.neighbors + 1, len(others)))
    own = (others.left[near] == pairs.left[:, None]) | (others.right[near] == pairs.right[:, None])
    own[~own.any(1), -1] = True  # as many neighbours for all
    taken = other_there[near] - np.einsum("kij,knj->kni", linear, other_here[near] - here[:, None])
    expected = np.nanmedian(np.where(own[:, :, None], np.nan, taken), axis=1)
    return np.asarray(np.linalg.norm(there - expected, axis=1) / np.sqrt(right.areas[pairs.right]))


def _compared_once(
    problem: MatchProblem, left: PolygonArrays, right: PolygonArrays, linear: Array, config: LocalConfig
) -> tuple[Array, Array, Array]:
    """As `_compared`; pairs of earlier problems of the same images are known."""
    lefts, rights = left.polygons, right.polygons
    keys = [(*identity(a), *identity(b), m.tobytes()) for a, b, m in zip(lefts, rights, linear, strict=True)]

    def find(rows: NDArray[np.intp]) -> list[tuple[float, float, float]]:
        here, there = (PolygonArrays([side[row] for row in rows]) for side in (lefts, rights))
        return list(zip(*_compared(problem, here, there, linear[rows], config), strict=True))

    found = each_once(problem.evidence, keys, lambda row: (vertices(lefts[row]), vertices(rights[row])), find)
    in_place, stretched, flowing = np.array(found, np.float64).reshape(-1, 3).T
    return in_place, stretched, flowing


def _compared(
    problem: MatchProblem, left: PolygonArrays, right: PolygonArrays, linear: Array, config: LocalConfig
) -> tuple[Array, Array, Array]:
    """(k,) content, (k,) texture and (k,) flow."""
    each = np.arange(len(left))
    warped = warp_by_points(left, *problem.initial.forward(), config)
    own = geometry.linearised(warped.maps, left.centers)[1]
    own = np.where(_usable(own)[:, None, None], own, linear)  # of the points in and around each polygon
    maps = by_areas(left, right, own)
    moved = transform_polygons(left, each, maps)
    in_place = content.peaks(problem.images, moved, right.shapes, maps, config.verify, config.max_halvings)
    by_points = np.where(_usable(warped.maps)[:, None, None], warped.maps, maps)
    put = transform_polygons(left, each, by_points)
    flowing = flow.agreement(problem.images, put, right.shapes, by_points, config.verify, config.max_halvings)
    maps = by_areas(left, right, linear)
    frames, sampling = transform_polygons(left, each, maps), (config.patch, config.max_halvings)
    patches = (
        texture.TexturePatches(problem.images[0], frames, np.linalg.inv(maps).astype(np.float64), *sampling),
        texture.TexturePatches(problem.images[1], right.shapes, np.broadcast_to(np.eye(3), maps.shape), *sampling),
    )
    stretched = np.maximum(texture.correlation(patches, Candidates(each, each), config.min_contrast), 0.0)
    return in_place, stretched, flowing


def _usable(maps: Array) -> NDArray[np.bool_]:
    """(k,) whether a square matrix, as a map or its linear part, is known and has an inverse."""
    known: NDArray[np.bool_] = np.asarray(np.isfinite(maps).all((1, 2)))
    return np.asarray(known & (np.abs(np.linalg.det(np.where(known[:, None, None], maps, 0.0))) > 1e-4))
