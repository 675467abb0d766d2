"""Regions of one photograph looked for in the other: warped by the points, and asked for again."""
