"""Scores of candidate pairs: overlap, shape, shared points, texture, and the resulting cost (paper 3.4.1, 3.4.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates, PyramidLocations
from zpm2.local_match import assignment, shape, texture
from zpm2.local_match.occlusion import unhidden
from zpm2.local_match.problem import MatchProblem
from zpm2.local_match.shared_points import shared_points
from zpm2.polygons import local_homography
from zpm2.polygons.once import each_once, identity, vertices
from zpm2.polygons.overlap import iou
from zpm2.polygons.shapes import as_objects
from zpm2.polygons.transform import transform_polygons
from zpm2.polygons.visible import co_visible

Array = NDArray[np.float64]


NO_MATCHES = Candidates(np.zeros(0, np.int64), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class CandidateScores:
    """The scores of c candidate pairs."""

    pairs: Candidates
    dsf: NDArray[np.int64]  # (c,) homologous points inside both
    agreement: Array  # (c,) 0..1, share of the points inside either that are inside both
    rectified: NDArray[np.object_]  # (c,) left polygon as the right image should show it
    overlap: Array  # (c,) 0..1, IoU of the rectified polygon with the right one
    area: Array  # (c,) 0..1, ratio of their areas
    visible: Array  # (c,) 0..1, share of either polygon, the smaller one, over which overlap and areas are compared
    psi: Array  # (c,) 0..1, similarity of shape
    texture: Array  # (c,) R, -1..1
    cost: Array  # (c,) zeta


class CandidateScorer:
    """Scores pairs of one problem. Data that all pairs need, such as texture patches, is computed once."""

    def __init__(self, problem: MatchProblem, config: LocalConfig) -> None:
        self.problem, self.config = problem, config
        self.left, self.right = problem.polygons
        self.guided_prior = problem.guided_prior
        self.shared_points = shared_points(problem.initial.points, self.left, self.right)
        each = np.arange(len(self.left))
        maps = problem.locations.maps(self.left.centers, each)
        maps[~np.isfinite(maps).all((1, 2))] = np.eye(3)
        frames = transform_polygons(self.left, each, maps)
        identity = np.broadcast_to(np.eye(3), (len(self.right), 3, 3))
        back = np.linalg.inv(maps).astype(np.float64)
        sampling = config.patch, config.max_halvings
        self.patches = (
            texture.TexturePatches(problem.images[0], frames, back, *sampling),
            texture.TexturePatches(problem.images[1], self.right.shapes, identity, *sampling),
        )

    def score(
        self, pairs: Candidates, locations: PyramidLocations, matched: Candidates = NO_MATCHES
    ) -> CandidateScores:
        """The scores of those pairs that pass the geometric constraint, with left polygons at `locations`.

        Where `config.visible` says so, what polygons that are `matched` hide of a pair is left out of the comparison.

        The constraint (the indicator I(G_i = G_j) of 3.1): a left polygon that hardly overlaps its candidate after
        rectification is not where the candidate is, however alike they look.
        """
        config, prior = self.config, self.guided_prior
        dsf, agreement = self.shared_points.counts_of(pairs), self.shared_points.agreement(pairs)
        least = np.full(len(pairs), config.min_overlap)
        if prior is not None:
            least = np.maximum(least, prior.least_overlap(pairs, agreement, dsf))
            rows = np.flatnonzero(np.isfinite(least))
            pairs, dsf, agreement, least = pairs[rows], dsf[rows], agreement[rows], least[rows]
        found = self._compared_once(pairs, locations, dsf, least, matched)
        rows = np.flatnonzero(found.overlap >= least)
        pairs, dsf, agreement, found = pairs[rows], dsf[rows], agreement[rows], found[rows]
        psi = found.overlap if config.shape == "overlap" else found.area * self._graph(found.rectified, pairs)[0]
        r = texture.correlation(self.patches, pairs, config.min_contrast)
        cost = assignment.matching_cost(psi, dsf, r, config)
        return CandidateScores(
            pairs, dsf, agreement, found.rectified, found.overlap, found.area, found.visible, psi, r, cost
        )

    def nodes(self, scores: CandidateScores, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The homologous vertices (k, 2) of each of the pairs `rows`."""
        return self._graph(scores.rectified[rows], scores.pairs[rows])[1]

    def _compared_once(
        self,
        pairs: Candidates,
        locations: PyramidLocations,
        dsf: NDArray[np.int64],
        least: Array,
        matched: Candidates,
    ) -> "_Overlaps":
        """How the pairs overlap; those of earlier problems of the same images are known."""
        lefts, rights = (
            [side.polygons[k] for k in of] for side, of in ((self.left, pairs.left), (self.right, pairs.right))
        )
        fronts = [self.left.polygons[k] for k in matched.left] + [self.right.polygons[k] for k in matched.right]
        others, kept = np.array([identity(front) for front in fronts]).tobytes(), [vertices(front) for front in fronts]
        keys = [
            (*identity(left), *identity(right), place.tobytes(), limit, others)
            for left, right, place, limit in zip(
                lefts, rights, locations.maps(self.left.centers, pairs.left), least.tolist(), strict=True
            )
        ]
        found = each_once(
            self.problem.known,
            keys,
            lambda row: (vertices(lefts[row]), vertices(rights[row]), kept),
            lambda rows: self._compared(pairs[rows], locations, dsf[rows], least[rows], matched).rows(),
        )
        return _Overlaps.of(found)

    def _compared(
        self,
        pairs: Candidates,
        locations: PyramidLocations,
        dsf: NDArray[np.int64],
        least: Array,
        matched: Candidates,
    ) -> "_Overlaps":
        maps = self._maps(pairs, self.shared_points.at(pairs), dsf, locations)
        rectified = transform_polygons(self.left, pairs.left, maps)
        found = self._overlaps(pairs, rectified, maps, dsf, least, matched)
        if self.guided_prior is None:
            return found
        warped, of = self.guided_prior.warped, pairs.left  # a second hypothesis; the one with more overlap counts
        return found.or_better(self._overlaps(pairs, warped.shapes[of], warped.maps[of], dsf, least, matched))

    def _overlaps(
        self,
        pairs: Candidates,
        rectified: NDArray[np.object_],
        maps: Array,
        dsf: NDArray[np.int64],
        least: Array,
        matched: Candidates,
    ) -> "_Overlaps":
        """Left polygons, `rectified` by `maps`, compared with the right ones: over all of both, or, with enough shared
        points, over what both photographs can show (`config.visible`). Pairs that cannot overlap by `least` (c,) have
        an overlap of 0."""
        right, limits = self.right.shapes[pairs.right], self.config.visible
        areas = shapely.area(rectified), shapely.area(right)
        own, other, visible = rectified.copy(), right.copy(), np.ones(len(pairs))
        if limits.on:
            known = np.flatnonzero(dsf >= limits.min_points)
            own[known], other[known] = self._shown(pairs[known], rectified[known], maps[known], matched)
            shares = [shapely.area(part) / np.maximum(a, 1e-300) for part, a in zip((own, other), areas, strict=True)]
            visible[known] = np.minimum(*shares)[known].clip(0, 1)
        overlap = np.where(visible >= limits.min_share, iou(own, other, least), 0.0)
        return _Overlaps(rectified, overlap, shape.area_ratio(shapely.area(own), shapely.area(other)), visible)

    def _shown(
        self, pairs: Candidates, rectified: NDArray[np.object_], maps: Array, matched: Candidates
    ) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
        """The parts of the `rectified` left and of the right polygons that both photographs can show: no border cuts
        them off, and no polygon that is `matched` hides them."""
        left, right, config = self.left.shapes[pairs.left], self.right.shapes[pairs.right], self.config
        first, second = ((image.width, image.height) for image in self.problem.images)
        own, other = co_visible(rectified, right, maps, left, (first, second), config.visible.border)
        return unhidden(own, other, pairs, maps, self.problem.polygons, matched, config.unmatched.max_shared)

    def _maps(
        self, pairs: Candidates, at: NDArray[np.int64], dsf: NDArray[np.int64], locations: PyramidLocations
    ) -> Array:
        """(c, 3, 3) from left to right: a homography of the pair's own where it shares gamma points, else the map of
        the left polygon's location, moved to the mean of the shared points if there are any."""
        points = self.problem.initial.points
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
            matrices[some[many]] = local_homography.fit_homographies(
                points, point[keep], renumbered, matrices[some[many]], self.config.homography
            )
        return matrices

    def _graph(self, rectified: NDArray[np.object_], pairs: Candidates) -> tuple[Array, list[NDArray[np.int64]]]:
        rings = [_exterior(s, self.left.polygons[i].exterior) for s, i in zip(rectified, pairs.left, strict=True)]
        others = [self.right.polygons[j].exterior for j in pairs.right]
        return shape.graph_similarity(rings, others, self.config.z, self.config.neighbors)


@dataclass(frozen=True, eq=False)
class _Overlaps:
    """How c left polygons, rectified, cover their candidates; members as those of `CandidateScores`."""

    rectified: NDArray[np.object_]
    overlap: Array
    area: Array
    visible: Array

    def __getitem__(self, rows: NDArray[np.intp]) -> "_Overlaps":
        return _Overlaps(self.rectified[rows], self.overlap[rows], self.area[rows], self.visible[rows])

    def rows(self) -> list[tuple[shapely.Geometry, float, float, float]]:
        """The members of each pair."""
        return list(zip(self.rectified, self.overlap, self.area, self.visible, strict=True))

    @staticmethod
    def of(rows: Sequence[tuple[shapely.Geometry, float, float, float]]) -> "_Overlaps":
        """The pairs of which these are the `rows`."""
        rectified, *numbers = zip(*rows, strict=True) if rows else ((), (), (), ())
        return _Overlaps(as_objects(rectified), *(np.array(each, np.float64) for each in numbers))

    def or_better(self, other: "_Overlaps") -> "_Overlaps":
        """Of each pair what overlaps more."""
        better = other.overlap > self.overlap
        return _Overlaps(*(np.where(better, getattr(other, f.name), getattr(self, f.name)) for f in fields(self)))


def _exterior(rectified: shapely.Geometry, original: Array) -> Array:
    """(n, 2) the exterior of a rectified polygon, with the vertices of the original one.

    If the polygon had to be repaired, the original exterior: the descriptor is invariant to all but the distortion.
    """
    if isinstance(rectified, shapely.Polygon) and not rectified.is_empty:
        ring = np.asarray(shapely.get_coordinates(rectified.exterior)[:-1])
        if len(ring) == len(original):
            return ring
    return original
