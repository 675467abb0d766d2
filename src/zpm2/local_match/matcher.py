"""The local matcher (paper 3.4): score the candidate pairs, assign them, and retry the polygons left unmatched."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates
from zpm2.local_match import assignment
from zpm2.local_match.problem import MatchProblem
from zpm2.local_match.scoring import CandidateScorer, CandidateScores
from zpm2.model import PolygonMatch, Stage


def match_polygons(problem: MatchProblem, config: LocalConfig, nodes: bool = True) -> list[PolygonMatch]:
    """One-to-one matches between the left and right polygons, in ascending order of left id.

    The first round assigns the candidates of the pyramid (`stage` "global"). The second round tries new pairs of
    polygons that are still unmatched: pairs that share homologous points, and pairs whose right polygon lies where the
    left one would be if it moved like its matched neighbours ("local", 3.4: re-matching of what the global stage could
    not resolve). With a `guided_prior`, right polygons that touch a warped left one are also candidates of the first
    round. A match with a polygon that was found by prompting is "guided". `confidence` is 0 until `verify` has seen
    the matches. Without `nodes` they lack homologous vertices, which take as long as the scores: for matches that only
    guide a further detection.
    """
    matches = []
    for scorer, scores, chosen, stage in _rounds(problem, config):
        matches += _as_matches(scorer, scores, chosen, stage, nodes)
    return sorted(matches, key=lambda match: match.left)


def possible_matches(problem: MatchProblem, config: LocalConfig) -> list[PolygonMatch]:
    """All pairs of both rounds of `match_polygons` that cost less than staying unmatched.

    A polygon may be in several pairs. `one_to_one` can then decide over many parts of an image at once.
    """
    matches = []
    for scorer, scores, _, stage in _rounds(problem, config):
        matches += _as_matches(scorer, scores, np.flatnonzero(scores.cost < config.iota), stage)
    return matches


def one_to_one(matches: Sequence[PolygonMatch], config: LocalConfig) -> list[PolygonMatch]:
    """The subset of `matches` with the lowest cost in which no polygon occurs twice (LHBGO, 3.4.3), by left id."""
    left, right, cost = (np.array([getattr(m, name) for m in matches]) for name in ("left", "right", "cost"))
    chosen = assignment.assign_optimal(Candidates(left.astype(int), right.astype(int)), cost.astype(float), config.iota)
    return sorted((matches[row] for row in chosen), key=lambda match: match.left)


def _rounds(
    problem: MatchProblem, config: LocalConfig
) -> Iterator[tuple[CandidateScorer, CandidateScores, NDArray[np.int64], Stage]]:
    """For each round: the scores of its pairs, the rows of the matched ones, and the stage."""
    left, right = problem.polygons
    if len(left) == 0 or len(right) == 0:
        return
    candidates = problem.candidates
    if problem.guided_prior is not None:
        candidates = problem.guided_prior.candidates(candidates, right)
    scorer = CandidateScorer(problem, config)
    first = scorer.score(candidates, problem.locations)
    chosen = _assign(first, config)
    yield scorer, first, chosen, "global"
    second = _second_round(scorer, first.pairs[chosen])
    yield scorer, second, _assign(second, config), "local"


def _assign(scores: CandidateScores, config: LocalConfig) -> NDArray[np.int64]:
    if config.assign == "greedy":
        return assignment.assign_greedy(scores.pairs, scores.psi, scores.cost, config.iota)
    return assignment.assign_optimal(scores.pairs, scores.cost, config.iota)


def _second_round(scorer: CandidateScorer, matched: Candidates) -> CandidateScores:
    """The scores of new pairs among the polygons that the first round left unmatched.

    Each left polygon moves from its prior location as the nearest matched polygons do. Its candidates are the right
    polygons there and those with which it shares homologous points. What the matched polygons hide of a pair does not
    count against it.
    """
    left, right, shared = scorer.left, scorer.right, scorer.shared_points.pairs
    free_left, free_right = np.ones(len(left), bool), np.ones(len(right), bool)
    free_left[matched.left] = free_right[matched.right] = False
    i, j = shared.left, shared.right
    locations, rows = scorer.problem.locations, np.flatnonzero(free_left)
    if len(matched) and len(rows):
        predicted = locations.prior.centers
        motion = right.centers[matched.right] - predicted[matched.left]
        count = min(scorer.config.nearest_matches, len(matched))
        _, near = cKDTree(left.centers[matched.left]).query(left.centers[rows], k=count)
        center = predicted.copy()
        center[rows] += np.median(motion[near.reshape(len(rows), -1)], axis=1)
        locations = dataclasses.replace(locations, centers=center)
        rows = rows[np.isfinite(center[rows]).all(1)]
        half_side = (left.bounds[rows, 2:] - left.bounds[rows, :2]).min(1, keepdims=True)
        half_side *= scorer.config.second_window / 2
        windows = shapely.box(*(center[rows] - half_side).T, *(center[rows] + half_side).T)
        hit, row = shapely.STRtree(right.shapes).query(windows, predicate="intersects")
        i, j = np.append(i, rows[hit]), np.append(j, row)
    free = free_left[i] & free_right[j]
    return scorer.score(Candidates.of(i[free], j[free]), locations, matched)


def _as_matches(
    scorer: CandidateScorer, scores: CandidateScores, rows: NDArray[np.int64], stage: Stage, with_nodes: bool = True
) -> list[PolygonMatch]:
    if len(rows) == 0:
        return []
    i, j = scores.pairs.left[rows], scores.pairs.right[rows]
    prior, nodes = scorer.guided_prior, [np.zeros((0, 2), np.int64)] * len(rows)
    if with_nodes:
        nodes = scorer.nodes(scores, rows)
    guided = np.zeros(len(rows), bool) if prior is None else prior.is_guided(scores.pairs[rows])
    return [
        PolygonMatch(
            left=int(scorer.left.ids[i[k]]),
            right=int(scorer.right.ids[j[k]]),
            confidence=0.0,
            cost=float(scores.cost[row]),
            dsf=int(scores.dsf[row]),
            stage="guided" if guided[k] else stage,
            overlap=float(scores.overlap[row]),
            visible=float(scores.visible[row]),
            nodes=nodes[k],
        )
        for k, row in enumerate(rows)
    ]
