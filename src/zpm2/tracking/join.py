"""Joins matches to tracks, which follow a region through many images, and resolves contradictions between matches.

The same image has other polygons in each pair, because guided detection adds some for the partner image. So polygons of
one image that cover the same area are first joined to one region. Matches then join regions of different images, the
most confident first. A match that would join two different regions of one image contradicts more confident matches and
is left out: a path of such matches leads from its one end to another region than its other end. The order of the input
only decides between matches of the same confidence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import shapely

from zpm2.model import Polygon, shapes_of

Node = tuple[int, int]  # a view, and a region of it


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


def build_tracks(matches: Sequence[TrackMatch], same: float, votes: bool = False) -> tuple[list[Track], int]:
    """The tracks, longest first, and the number of matches that contradict others (a cycle that does not close).

    same: two polygons of one image are one region if their IoU is at least this. votes: matches are weighed by their
    confidence and by what matches of third images say of them (`_votes`), instead of by their confidence alone.
    """
    matches = sorted(matches, key=lambda match: (match.carried, -match.confidence))
    region = _regions(matches, same)
    ends = [
        ((s.view, region[s.view, s.pair, s.polygon.id]), (t.view, region[t.view, t.pair, t.polygon.id]))
        for s, t in ((match.left, match.right) for match in matches)
    ]
    weight = _votes(matches, ends) if votes else [match.confidence for match in matches]
    order = sorted(range(len(matches)), key=lambda k: (matches[k].carried, -weight[k]))
    root: dict[Node, Node] = {}
    members: dict[Node, dict[int, int]] = {}  # root -> view -> region

    def find(node: Node) -> Node:
        if node not in root:
            root[node] = node
            members[node] = {node[0]: node[1]}
        while root[node] != node:
            root[node] = root[root[node]]
            node = root[node]
        return node

    used: list[int] = []
    contradicted = 0
    for k in order:
        a, b = (find(end) for end in ends[k])
        if a != b:
            shared = members[a].keys() & members[b].keys()
            if any(members[a][view] != members[b][view] for view in shared):
                contradicted += 1
                continue
            root[b] = a
            members[a] |= members.pop(b)
        used.append(k)
    groups: dict[Node, list[TrackMatch]] = {}
    for k in used:
        groups.setdefault(find(ends[k][0]), []).append(matches[k])
    tracks = [Track(tuple(sorted(group, key=lambda m: (m.carried, -m.confidence)))) for group in groups.values()]
    return sorted(tracks, key=lambda t: -len(t.views)), contradicted


def _votes(matches: Sequence[TrackMatch], ends: Sequence[tuple[Node, Node]]) -> list[float]:
    """0..1 of each match, the share of the votes that are for it.

    A match of a and b votes for itself by its confidence, of 1. Each third image that a or b has a match with votes for
    it or against it, by the product of the confidences of the two matches: for it, where both lead to the same region;
    against it, where they lead to two, or where a's leads on to another region of b's image, or b's to another of a's.
    Carried matches have no vote. Of several matches of a region with one image the first counts.
    """
    partners: dict[Node, dict[int, tuple[Node, float]]] = {}
    for match, (a, b) in zip(matches, ends, strict=True):
        if not match.carried:
            partners.setdefault(a, {}).setdefault(b[0], (b, match.confidence))
            partners.setdefault(b, {}).setdefault(a[0], (a, match.confidence))
    found = []
    for match, (a, b) in zip(matches, ends, strict=True):
        votes, cast = match.confidence, 1.0
        for view in sorted((partners.get(a, {}).keys() | partners.get(b, {}).keys()) - {a[0], b[0]}):
            agrees, weight = _vote(a, b, view, partners)
            votes, cast = votes + agrees * weight, cast + weight
        found.append(votes / cast)
    return found


def _vote(a: Node, b: Node, view: int, partners: Mapping[Node, Mapping[int, tuple[Node, float]]]) -> tuple[bool, float]:
    """Whether the region of a third view is for a match of a and b, and the weight of its vote; 0 without one."""
    of_a, of_b = partners.get(a, {}).get(view), partners.get(b, {}).get(view)
    if of_a is not None and of_b is not None:
        return of_a[0] == of_b[0], of_a[1] * of_b[1]
    known, target = (of_a, b) if of_b is None else (of_b, a)
    assert known is not None
    onward = partners[known[0]].get(target[0])  # another region than the target, which knows none of the view
    return False, 0.0 if onward is None else known[1] * onward[1]


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
        shapes = shapes_of([observations[key].polygon for key in keys])
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
