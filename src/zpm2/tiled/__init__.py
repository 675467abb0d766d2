"""Photographs of any size, in bounded memory: tiles of several scales, stitched, matched in blocks."""
