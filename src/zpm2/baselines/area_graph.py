"""MESA's area graph: which regions of an image lie in each other, and which ones meet."""

from dataclasses import dataclass

import shapely

from zpm2.model import PolygonArrays


@dataclass(frozen=True, eq=False)
class AreaGraph:
    """The relations of the n regions of an image; each list has an entry for each region."""

    parents: list[set[int]]  # regions that hold it
    children: list[set[int]]  # regions that it holds
    neighbours: list[set[int]]  # regions that it overlaps or touches otherwise
    iou: list[dict[int, float]]  # IoU with each region that shares area with it


def area_graph(polygons: PolygonArrays, contained: float) -> AreaGraph:
    """The graph of an image. A region is the child of a larger one that holds the share `contained` of its area."""
    n, shapes, areas = len(polygons), polygons.shapes, polygons.areas
    parents, children, neighbours = ([set[int]() for _ in range(n)] for _ in range(3))
    graph = AreaGraph(parents, children, neighbours, [{} for _ in range(n)])
    if not n:
        return graph
    first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    once = first < second
    first, second = first[once], second[once]
    shared = shapely.area(shapely.intersection(shapes[first], shapes[second]))
    for i, j, common in zip(first.tolist(), second.tolist(), shared.tolist(), strict=True):
        small, large = (i, j) if areas[i] <= areas[j] else (j, i)
        if areas[small] < areas[large] and common >= contained * areas[small]:
            graph.parents[small].add(large)
            graph.children[large].add(small)
        else:
            graph.neighbours[i].add(j)
            graph.neighbours[j].add(i)
        if common > 0:
            graph.iou[i][j] = graph.iou[j][i] = float(common / (areas[i] + areas[j] - common))
    return graph
