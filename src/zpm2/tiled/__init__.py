"""Photographs of any size, in bounded memory: tiles of several scales, stitched, matched in blocks."""

from zpm2.tiled.matcher import TiledMatcher

__all__ = ["TiledMatcher"]
