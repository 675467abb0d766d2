"""Which polygon lies in which."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import shapely

from zpm2.model import Polygon

CONTAINED = 0.95  # share of a polygon's area that must lie in another one for that to be its parent


def with_parents(polygons: Sequence[Polygon]) -> list[Polygon]:
    """The same polygons, each with the id of the smallest larger one that holds at least 95 % of its area as parent."""
    if not polygons:
        return []
    shapes = np.array([p.shape for p in polygons], object)
    areas = shapely.area(shapes)
    child, parent = shapely.STRtree(shapes).query(shapes)
    boxes = shapely.bounds(shapes)
    common = np.minimum(boxes[child, 2:], boxes[parent, 2:]) - np.maximum(boxes[child, :2], boxes[parent, :2])
    possible = (areas[parent] > areas[child]) & (common.prod(1) >= CONTAINED * areas[child])
    child, parent = child[possible], parent[possible]
    held = shapely.area(shapely.intersection(shapes[child], shapes[parent])) >= CONTAINED * areas[child]
    child, parent = child[held], parent[held]
    order = np.lexsort((parent, areas[parent], child))
    _, first = np.unique(child[order], return_index=True)
    parent_of = {int(c): polygons[int(p)].id for c, p in zip(child[order][first], parent[order][first], strict=True)}
    return [dataclasses.replace(p, parent=parent_of.get(k)) for k, p in enumerate(polygons)]
