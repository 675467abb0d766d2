"""Regions of one photograph: found by SAM or brought along, as pixels and as polygons (paper 3.2)."""
