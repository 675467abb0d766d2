"""Joins matches to tracks, which follow a region through many images, and resolves contradictions between matches.

The same image has other polygons in each pair, because guided detection adds some for the partner image. So polygons of
one image that cover the same area are first joined to one region. Matches then join regions of different images, the
most confident first. A match that would join two different regions of one image contradicts more confident matches and
is left out: a path of such matches leads from its one end to another region than its other end. The order of the input
only decides between matches of the same confidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from zpm2.model import Polygon


@dataclass(frozen=True)
class Observation:
    """A polygon of a view in one matched pair."""

    view: int  # index of the view
    pair: int  # index of the matched pair of images
    polygon: Polygon


@dataclass(frozen=True)
class TrackMatch:
    """A match of two observations."""

    left: Observation
    right: Observation
    confidence: float  # 0..1
    carried: bool = False  # by `zpm2.carry`; every match of two detected regions comes before these


@dataclass(frozen=True)
class Track:
    """One region in several views."""

    matches: tuple[TrackMatch, ...]  # the most confident first

    @property
    def observations(self) -> list[Observation]:
        """The polygons of the track, each once, in the order of the matches."""
        found = {(s.view, s.pair, s.polygon.id): s for match in self.matches for s in (match.left, match.right)}
        return list(found.values())

    @property
    def seen(self) -> dict[int, Observation]:
        """By view the polygon of the most confident match."""
        found: dict[int, Observation] = {}
        for observation in self.observations:
            found.setdefault(observation.view, observation)
        return found

    @property
    def views(self) -> list[int]:
        """Indices of the views that see the region, ascending."""
        return sorted({observation.view for observation in self.observations})


def build_tracks(matches: Sequence[TrackMatch], same: float) -> tuple[list[Track], int]:
    """The tracks, longest first, and the number of matches that contradict others (a cycle that does not close).

    same: two polygons of one image are one region if their IoU is at least this.
    """
    order = sorted(range(len(matches)), key=lambda k: (matches[k].carried, -matches[k].confidence))
    region = _regions([matches[k] for k in order], same)
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
        ends = [(s.view, region[s.view, s.pair, s.polygon.id]) for s in (matches[k].left, matches[k].right)]
        a, b = find(ends[0]), find(ends[1])
        if a != b:
            shared = members[a].keys() & members[b].keys()
            if any(members[a][view] != members[b][view] for view in shared):
                contradicted += 1
                continue
            root[b] = a
            members[a] |= members.pop(b)
        used.append((k, ends[0]))
    groups: dict[tuple[int, int], list[TrackMatch]] = {}
    for k, node in used:
        groups.setdefault(find(node), []).append(matches[k])
    tracks = [Track(tuple(group)) for group in groups.values()]
    return sorted(tracks, key=lambda t: -len(t.views)), contradicted


def _regions(matches: Sequence[TrackMatch], same: float) -> dict[tuple[int, int, int], int]:
    """For each observation (view, pair, polygon id), the index of its region among those of its view.

    Two polygons of one pair are always different regions. Polygons are taken in the order of their matches, the most
    confident first. Each joins the region with the largest IoU of at least `same` that does not contain a polygon of
    its own pair yet; otherwise it starts a new region.
    """
    by_view: dict[int, dict[tuple[int, int], Observation]] = {}
    for match in matches:
        for seen in (match.left, match.right):
            by_view.setdefault(seen.view, {})[seen.pair, seen.polygon.id] = seen
    result: dict[tuple[int, int, int], int] = {}
    for view, observations in by_view.items():
        keys = list(observations)
        shapes = np.array([observations[key].polygon.shape for key in keys], object)
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
