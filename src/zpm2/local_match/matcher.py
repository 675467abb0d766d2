"""The local matcher (paper 3.4): evaluate candidate pairs, assign them, and match again what is left."""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates, InitialGeometry, PyramidLocations
from zpm2.guided.prior import GuidedPrior
from zpm2.local_match import assignment, shape, texture
from zpm2.local_match.confidence import confidence
from zpm2.local_match.shared_points import SharedPoints, lookup, shared_points
from zpm2.model import Image, PolygonArrays, PolygonMatch, Stage
from zpm2.polygons import local_homography
from zpm2.polygons.overlap import overlaps
from zpm2.polygons.transform import transformed

Array = NDArray[np.float64]
NEIGHBORS = 5  # matched polygons whose motion predicts an unmatched one's


@dataclass(frozen=True, eq=False)
class CandidateScores:
    """What is known about each of c candidate pairs."""

    pairs: Candidates
    dsf: NDArray[np.int64]  # (c,) homologous points inside both
    agreement: Array  # (c,) 0..1, share of the points inside either that are inside both
    rectified: NDArray[np.object_]  # (c,) left polygon as the right image should show it
    overlap: Array  # (c,) 0..1, IoU of the rectified polygon with the right one
    area: Array  # (c,) 0..1, ratio of their areas
    psi: Array  # (c,) 0..1, similarity of shape
    texture: Array  # (c,) R, -1..1
    cost: Array  # (c,) zeta


class _CandidateScorer:
    """Everything that the evidence of a pair is drawn from, prepared once per image pair."""

    def __init__(
        self,
        images: tuple[Image, Image],
        polygons: tuple[PolygonArrays, PolygonArrays],
        initial: InitialGeometry,
        locations: PyramidLocations,
        config: LocalConfig,
        guided_prior: GuidedPrior | None,
    ) -> None:
        self.left, self.right = polygons
        self.guided_prior = guided_prior
        self.initial, self.locations, self.config = initial, locations, config
        self.shared_points: SharedPoints = shared_points(initial.points, self.left, self.right)
        each = np.arange(len(self.left))
        maps = locations.maps(self.left.centers, each)
        maps[~np.isfinite(maps).all((1, 2))] = np.eye(3)
        frames = transformed(self.left, each, maps)
        identity = np.broadcast_to(np.eye(3), (len(self.right), 3, 3))
        self.left_patches = texture.Patches(images[0], frames, np.linalg.inv(maps).astype(np.float64), config.patch)
        self.right_patches = texture.Patches(images[1], self.right.shapes, identity, config.patch)

    def evaluate(self, pairs: Candidates, locations: PyramidLocations) -> CandidateScores:
        """The evidence of those pairs that pass the geometric constraint, with left polygons where `locations` puts
        them: a rectified polygon that hardly covers its candidate is not where that candidate is, however alike they
        look (the indicator I(G_i = G_j) of 3.1)."""
        config = self.config
        at = lookup(np.arange(len(self.shared_points.pairs)), self.shared_points.pairs, pairs)
        dsf = np.where(at >= 0, self.shared_points.counts[np.maximum(at, 0)] if len(self.shared_points.pairs) else 0, 0)
        rectified = transformed(self.left, pairs.left, self._maps(pairs, at, dsf, locations))
        overlap = overlaps(rectified, self.right.shapes[pairs.right])
        agreement = self._agreement(pairs, dsf)
        near = overlap >= config.min_overlap
        if self.guided_prior is not None:  # a second hypothesis, of which the better one counts
            warped = self.guided_prior.warped.shapes[pairs.left]
            other = overlaps(warped, self.right.shapes[pairs.right])
            rectified, overlap = np.where(other > overlap, warped, rectified), np.maximum(overlap, other)
            near = self.guided_prior.believes(pairs, overlap, agreement) & (overlap >= config.min_overlap)
        rows = np.flatnonzero(near)
        pairs, dsf, agreement = pairs[rows], dsf[rows], agreement[rows]
        rectified, overlap = rectified[rows], overlap[rows]
        area = shape.area_ratio(shapely.area(rectified), self.right.areas[pairs.right])
        psi = overlap if config.shape == "overlap" else area * self._graph(rectified, pairs)[0]
        r = texture.correlation(self.left_patches, pairs.left, self.right_patches, pairs.right)
        cost = assignment.matching_cost(psi, dsf, r, config.gamma, config.epsilon, config.few_points)
        return CandidateScores(pairs, dsf, agreement, rectified, overlap, area, psi, r, cost)

    def _agreement(self, pairs: Candidates, dsf: NDArray[np.int64]) -> Array:
        """(c,) 0..1, share of the homologous points inside either polygon that are inside both, with one point for and
        one against it before the first is seen."""
        either = self.shared_points.inside[0][pairs.left] + self.shared_points.inside[1][pairs.right] - dsf
        return (dsf + 1) / (either + 2)

    def _maps(
        self, pairs: Candidates, at: NDArray[np.int64], dsf: NDArray[np.int64], locations: PyramidLocations
    ) -> Array:
        """(c, 3, 3): a homography of the pair's own from gamma points on, the placed map moved to the points from one
        point on, the placed map otherwise."""
        points = self.initial.points
        matrices = locations.maps(self.left.centers, pairs.left)
        matrices[~np.isfinite(matrices).all((1, 2))] = np.eye(3)
        some = np.flatnonzero(dsf > 0)
        if len(some) == 0:
            return matrices
        start, count = self.shared_points.start[at[some]], dsf[some]
        group = np.repeat(np.arange(len(some)), count)
        first = np.cumsum(count) - count
        point = self.shared_points.point[np.arange(len(group)) - first[group] + start[group]]
        moved = np.einsum("kij,kj->ki", matrices[some][group][:, :2, :2], points.left[point])
        matrices[some, :2, 2] = np.add.reduceat(points.right[point] - moved, first, axis=0) / count[:, None]
        many = count >= self.config.gamma
        if many.any():
            keep = many[group]
            renumbered = (np.cumsum(many) - 1)[group[keep]]
            fitted = local_homography.fit_homographies(points, point[keep], renumbered, matrices[some[many]])
            matrices[some[many]] = fitted
        return matrices

    def _graph(self, rectified: NDArray[np.object_], pairs: Candidates) -> tuple[Array, list[NDArray[np.int64]]]:
        rings = [_exterior(s, self.left.polygons[i].exterior) for s, i in zip(rectified, pairs.left, strict=True)]
        others = [self.right.polygons[j].exterior for j in pairs.right]
        return shape.graph_similarity(rings, others, self.config.z, self.config.neighbors)

    def nodes(self, scores: CandidateScores, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The homologous vertices (k, 2) of the pairs `rows`."""
        return self._graph(scores.rectified[rows], scores.pairs[rows])[1]


def match_polygons(
    images: tuple[Image, Image],
    polygons: tuple[PolygonArrays, PolygonArrays],
    initial: InitialGeometry,
    locations: PyramidLocations,
    candidates: Candidates,
    config: LocalConfig,
    guided_prior: GuidedPrior | None = None,
) -> list[PolygonMatch]:
    """One-to-one matches between the left and right polygons, in ascending order of left id.

    First the candidates of the pyramid (`stage` "global"), assigned together. Then the polygons that stayed unmatched
    are tried with pairs that the pyramid did not propose: those that share homologous points, and those to which the
    motion of matched neighbours leads ("local", 3.4: re-matching of what the global stage could not resolve). With
    `guided_prior`, right polygons that touch a warped left one are candidates of the first round as well, and a match
    of which one polygon was found by prompting is "guided".
    """
    matches = []
    for evaluator, scores, chosen, stage in _rounds(
        images, polygons, initial, locations, candidates, config, guided_prior
    ):
        matches += _as_matches(evaluator, scores, chosen, stage)
    return sorted(matches, key=lambda match: match.left)


def possible_matches(
    images: tuple[Image, Image],
    polygons: tuple[PolygonArrays, PolygonArrays],
    initial: InitialGeometry,
    locations: PyramidLocations,
    candidates: Candidates,
    config: LocalConfig,
    guided_prior: GuidedPrior | None = None,
) -> list[PolygonMatch]:
    """Every pair of both rounds of `match_polygons` that costs less than staying unmatched, for `one_to_one` to decide
    over those of many parts of an image at once. A polygon may be in several."""
    matches = []
    for evaluator, scores, _, stage in _rounds(images, polygons, initial, locations, candidates, config, guided_prior):
        matches += _as_matches(evaluator, scores, np.flatnonzero(scores.cost < config.iota), stage)
    return matches


def one_to_one(matches: Sequence[PolygonMatch], config: LocalConfig) -> list[PolygonMatch]:
    """The matches of least cost in all of which each polygon has one at most (LHBGO, 3.4.3), by ascending left id."""
    left, right, cost = (np.array([getattr(m, name) for m in matches]) for name in ("left", "right", "cost"))
    chosen = assignment.assign_optimal(Candidates(left.astype(int), right.astype(int)), cost.astype(float), config.iota)
    return sorted((matches[row] for row in chosen), key=lambda match: match.left)


def _rounds(
    images: tuple[Image, Image],
    polygons: tuple[PolygonArrays, PolygonArrays],
    initial: InitialGeometry,
    locations: PyramidLocations,
    candidates: Candidates,
    config: LocalConfig,
    guided_prior: GuidedPrior | None,
) -> Iterator[tuple[_CandidateScorer, CandidateScores, NDArray[np.int64], Stage]]:
    """Of both rounds: the evidence of their pairs, and which of these are matched."""
    if len(polygons[0]) == 0 or len(polygons[1]) == 0:
        return
    if guided_prior is not None:
        candidates = guided_prior.candidates(candidates, polygons[1])
    evaluator = _CandidateScorer(images, polygons, initial, locations, config, guided_prior)
    first = evaluator.evaluate(candidates, locations)
    chosen = _assign(first, config)
    yield evaluator, first, chosen, "global"
    second = _second_round(evaluator, first.pairs[chosen])
    yield evaluator, second, _assign(second, config), "local"


def _assign(scores: CandidateScores, config: LocalConfig) -> NDArray[np.int64]:
    if config.assign == "greedy":
        return assignment.assign_greedy(scores.pairs, scores.psi, scores.cost, config.iota)
    return assignment.assign_optimal(scores.pairs, scores.cost, config.iota)


def _second_round(evaluator: _CandidateScorer, matched: Candidates) -> CandidateScores:
    """Evidence of new pairs among the polygons that the first round left unmatched.

    They are put where they are expected, moved as the matched neighbours are from there. Candidates are the right
    polygons there and those that share homologous points.
    """
    left, right, known = evaluator.left, evaluator.right, evaluator.shared_points
    free_left, free_right = np.ones(len(left), bool), np.ones(len(right), bool)
    free_left[matched.left] = free_right[matched.right] = False
    i, j = known.pairs.left, known.pairs.right
    locations, rows = evaluator.locations, np.flatnonzero(free_left)
    if len(matched) and len(rows):
        predicted = locations.expected.centers
        motion = right.centers[matched.right] - predicted[matched.left]
        _, near = cKDTree(left.centers[matched.left]).query(left.centers[rows], k=min(NEIGHBORS, len(matched)))
        center = predicted.copy()
        center[rows] += np.median(motion[near.reshape(len(rows), -1)], axis=1)
        locations = dataclasses.replace(locations, centers=center)
        rows = rows[np.isfinite(center[rows]).all(1)]
        reach = (left.bounds[rows, 2:] - left.bounds[rows, :2]).min(1, keepdims=True) / 2
        windows = shapely.box(*(center[rows] - reach).T, *(center[rows] + reach).T)
        hit, row = shapely.STRtree(right.shapes).query(windows, predicate="intersects")
        i, j = np.append(i, rows[hit]), np.append(j, row)
    free = free_left[i] & free_right[j]
    return evaluator.evaluate(Candidates.of(i[free], j[free]), locations)


def _as_matches(
    evaluator: _CandidateScorer, scores: CandidateScores, rows: NDArray[np.int64], stage: Stage
) -> list[PolygonMatch]:
    if len(rows) == 0:
        return []
    i, j = scores.pairs.left[rows], scores.pairs.right[rows]
    sure = confidence(scores.overlap[rows], scores.dsf[rows], scores.texture[rows], scores.area[rows])
    nodes = evaluator.nodes(scores, rows)
    guided_prior = evaluator.guided_prior
    guided = np.zeros(len(rows), bool) if guided_prior is None else guided_prior.found(scores.pairs[rows])
    return [
        PolygonMatch(
            left=int(evaluator.left.ids[i[k]]),
            right=int(evaluator.right.ids[j[k]]),
            confidence=float(sure[k]),
            cost=float(scores.cost[row]),
            dsf=int(scores.dsf[row]),
            stage="guided" if guided[k] else stage,
            overlap=float(scores.overlap[row]),
            nodes=nodes[k],
        )
        for k, row in enumerate(rows)
    ]


def _exterior(rectified: shapely.Geometry, original: Array) -> Array:
    """(n, 2) the exterior ring of a rectified polygon, vertex by vertex that of the original ring; where rectification
    tore the polygon, the original ring itself, to which the descriptor is indifferent but for the distortion."""
    if isinstance(rectified, shapely.Polygon) and not rectified.is_empty:
        ring = np.asarray(shapely.get_coordinates(rectified.exterior)[:-1])
        if len(ring) == len(original):
            return ring
    return original
