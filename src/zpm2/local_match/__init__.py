"""Local matching (paper 3.4): shape, texture and one assignment over all candidates."""

from zpm2.local_match.matcher import match_polygons, one_to_one, possible_matches
from zpm2.local_match.problem import MatchProblem

__all__ = ["MatchProblem", "match_polygons", "one_to_one", "possible_matches"]
