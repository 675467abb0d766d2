"""Polygons and pixels: trace, rasterize, simplify, nest, overlap, warp."""
