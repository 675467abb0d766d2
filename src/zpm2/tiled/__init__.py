"""Photographs of any size, in bounded memory: tiles of several scales, stitched, matched in blocks."""

from zpm2.api import Matcher

__all__ = ["TiledMatcher"]
