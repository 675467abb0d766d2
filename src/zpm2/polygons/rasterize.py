"""Polygons to pixels: the one rule for which pixel lies inside."""

import numpy as np
import shapely

from zpm2.model import Mask


def rasterize(shape: shapely.Polygon) -> Mask:
    """The pixels whose centre lies in `shape` (image px), as the crop of its bounds; undoes `trace`.

    A centre on an outline belongs to what lies to the right of it or below, so that polygons which share an edge share
    no pixel and leave none out.
    """
    x_min, y_min, x_max, y_max = shape.bounds
    x0, y0 = int(np.floor(x_min)), int(np.floor(y_min))
    width, height = int(np.ceil(x_max)) - x0, int(np.ceil(y_max)) - y0
    rings = [shapely.get_coordinates(ring) for ring in (shape.exterior, *shape.interiors)]
    a, b = np.concatenate([ring[:-1] for ring in rings]), np.concatenate([ring[1:] for ring in rings])
    down = (a[:, 1] <= b[:, 1])[:, None]
    a, b = np.where(down, a, b), np.where(down, b, a)  # an edge is the same from both of its sides, to the last bit
    first = np.ceil(a[:, 1] - 0.5).astype(np.int64)  # rows whose centre line an edge crosses
    count = np.ceil(b[:, 1] - 0.5).astype(np.int64) - first
    edge = np.repeat(np.arange(len(a)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    a, b = a[edge], b[edge]
    crossing = a[:, 0] + (row + 0.5 - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    column = np.ceil(crossing - 0.5).astype(np.int64)  # first pixel with its centre right of the crossing
    crossings = np.bincount((row - y0) * (width + 1) + column - x0, minlength=height * (width + 1))
    inside = np.cumsum(crossings.reshape(height, width + 1), axis=1)[:, :width] % 2 == 1
    return Mask(x0, y0, inside)
