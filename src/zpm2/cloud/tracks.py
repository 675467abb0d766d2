"""Regions followed through many images: matches chained, and every chain brought back to where it began.

Each pair of images has polygons of its own (guided detection asks one image about the other), so those of one image
that cover the same are first made one region. Matches then join regions, the surest first; one that would join two
different regions of one image contradicts the surer ones, and is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from zpm2.model import Polygon


@dataclass(frozen=True)
class Sighting:
    """A polygon of a view, as a match knows it."""

    view: int  # index of the view
    pair: int  # index of the matched pair of images
    polygon: Polygon


@dataclass(frozen=True)
class Link:
    """A match of two sightings."""

    left: Sighting
    right: Sighting
    confidence: float  # 0..1


@dataclass(frozen=True)
class Track:
    """One region in several views."""

    links: tuple[Link, ...]  # all of its matches, the surest first

    @property
    def sightings(self) -> list[Sighting]:
        """Each polygon of it once, in the order of the links."""
        found = {(s.view, s.pair, s.polygon.id): s for link in self.links for s in (link.left, link.right)}
        return list(found.values())

    @property
    def views(self) -> list[int]:
        """The views that see it, ascending."""
        return sorted({sighting.view for sighting in self.sightings})


def chain(links: Sequence[Link], same: float) -> tuple[list[Track], int]:
    """The tracks, longest first, and how many links contradict others (a cycle that does not close).

    same: IoU from which on two polygons of one image are one region.
    """
    order = sorted(range(len(links)), key=lambda k: -links[k].confidence)
    region = _regions([links[k] for k in order], same)
    root: dict[tuple[int, int], tuple[int, int]] = {}
    members: dict[tuple[int, int], dict[int, int]] = {}  # root -> view -> region

    def find(node: tuple[int, int]) -> tuple[int, int]:
        if node not in root:
            root[node] = node
            members[node] = {node[0]: node[1]}
        while root[node] != node:
            root[node] = root[root[node]]
            node = root[node]
        return node

    used: list[tuple[int, tuple[int, int]]] = []
    contradicted = 0
    for k in order:
        ends = [(s.view, region[s.view, s.pair, s.polygon.id]) for s in (links[k].left, links[k].right)]
        a, b = find(ends[0]), find(ends[1])
        if a != b:
            shared = members[a].keys() & members[b].keys()
            if any(members[a][view] != members[b][view] for view in shared):
                contradicted += 1
                continue
            root[b] = a
            members[a] |= members.pop(b)
        used.append((k, ends[0]))
    groups: dict[tuple[int, int], list[Link]] = {}
    for k, node in used:
        groups.setdefault(find(node), []).append(links[k])
    tracks = [Track(tuple(group)) for group in groups.values()]
    return sorted(tracks, key=lambda t: -len(t.views)), contradicted


def _regions(links: Sequence[Link], same: float) -> dict[tuple[int, int, int], int]:
    """The region of each sighting, by view, pair and polygon's id: an index among those of its view.

    The polygons of one pair are different regions. Each polygon, those of the surest matches first, joins the region
    that it covers best, if it covers `same` of it or more and none of its own pair is in it yet.
    """
    by_view: dict[int, dict[tuple[int, int], Sighting]] = {}
    for link in links:
        for sighting in (link.left, link.right):
            by_view.setdefault(sighting.view, {})[sighting.pair, sighting.polygon.id] = sighting
    result: dict[tuple[int, int, int], int] = {}
    for view, sightings in by_view.items():
        keys = list(sightings)
        shapes = np.array([sightings[key].polygon.shape for key in keys], object)
        area = shapely.area(shapes)
        first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        first, second = first[first != second], second[first != second]
        both = shapely.area(shapely.intersection(shapes[first], shapes[second]))
        iou = both / (area[first] + area[second] - both)
        near: dict[int, list[tuple[float, int]]] = {}
        for a, b, value in zip(first.tolist(), second.tolist(), iou.tolist(), strict=True):
            if value >= same:
                near.setdefault(a, []).append((value, b))
        at: dict[int, int] = {}
        pairs_of: list[set[int]] = []
        for k, (pair, _) in enumerate(keys):
            choices = sorted(((value, at[b]) for value, b in near.get(k, []) if b in at), reverse=True)
            chosen = next((r for _, r in choices if pair not in pairs_of[r]), None)
            if chosen is None:
                chosen = len(pairs_of)
                pairs_of.append(set())
            pairs_of[chosen].add(pair)
            at[k] = chosen
        result |= {(view, *key): at[k] for k, key in enumerate(keys)}
    return result
