"""The last judge: gives every match its confidence and rejects what is not sure enough. It proposes nothing."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates
from zpm2.local_match import MatchProblem
from zpm2.model import PolygonMatch
from zpm2.model.messages import Note
from zpm2.verify.confidence import confidence
from zpm2.verify.evidence import gather


def verified(
    problem: MatchProblem, matches: Sequence[PolygonMatch], others: Sequence[PolygonMatch], config: LocalConfig
) -> list[PolygonMatch]:
    """The matches with their confidence, if both photographs show the same scene. Their motion is compared with that
    of the matches `others`."""
    if not matches:
        return []
    rows = [{int(id): row for row, id in enumerate(side.ids)} for side in problem.polygons]

    def pairs(some: Sequence[PolygonMatch]) -> Candidates:
        left, right = [rows[0][match.left] for match in some], [rows[1][match.right] for match in some]
        return Candidates(np.array(left, np.int64), np.array(right, np.int64))

    evidence = gather(problem, pairs(matches), pairs(others), config)
    chance = confidence(evidence, config.confidence)
    return [dataclasses.replace(m, confidence=float(c)) for m, c in zip(matches, chance, strict=True)]


def judged(
    matches: Sequence[PolygonMatch], config: LocalConfig, given: bool = False
) -> tuple[list[PolygonMatch], list[str]]:
    """The verified matches that the judge does not reject, and a note on how many it does. Regions that were `given`
    are matched as far as they can be: whoever gave them knows better what is worth looking at."""
    if config.judge == "off" or given:
        return list(matches), []
    least = config.verify.min_confidence
    kept = [match for match in matches if match.confidence >= least]
    gone = len(matches) - len(kept)
    return kept, [Note(f"{gone} of {len(matches)} matches were rejected: less than {least:g} sure")] if gone else []


def same_scene_matches(matches: Sequence[PolygonMatch], probability: float) -> list[PolygonMatch]:
    """The matches of two photographs that show the same scene with this `probability` (`InitialGeometry.same_scene`):
    each is right if they do and it is. For a whole pair only: a part of a large one may just have few points."""
    return [dataclasses.replace(match, confidence=probability * match.confidence) for match in matches]
