"""Which polygon lies in which."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import shapely

from zpm2.config import VectorizeConfig
from zpm2.model import Polygon, shapes_of
from zpm2.polygons.overlap import shared_box


def with_parents(polygons: Sequence[Polygon], config: VectorizeConfig) -> list[Polygon]:
    """The same polygons with their parents.

    The parent is the id of the smallest larger polygon that contains at least the share `config.min_contained` of the
    polygon's area.
    """
    if not polygons:
        return []
    shapes = shapes_of(polygons)
    areas = shapely.area(shapes)
    child, parent = shapely.STRtree(shapes).query(shapes)
    boxes = shapely.bounds(shapes)
    common = shared_box(boxes[child], boxes[parent])
    possible = (areas[parent] > areas[child]) & (common >= config.min_contained * areas[child])
    child, parent = child[possible], parent[possible]
    shared = shapely.area(shapely.intersection(shapes[child], shapes[parent]))
    contained = shared >= config.min_contained * areas[child]
    child, parent = child[contained], parent[contained]
    order = np.lexsort((parent, areas[parent], child))
    _, first = np.unique(child[order], return_index=True)
    parent_of = {int(c): polygons[int(p)].id for c, p in zip(child[order][first], parent[order][first], strict=True)}
    return [dataclasses.replace(p, parent=parent_of.get(k)) for k, p in enumerate(polygons)]
