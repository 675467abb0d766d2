"""Which polygon is which: shape, texture and one assignment over all candidates (paper 3.4)."""

from zpm2.local_match.matcher import match_polygons, one_to_one, possible_matches

__all__ = ["match_polygons", "one_to_one", "possible_matches"]
