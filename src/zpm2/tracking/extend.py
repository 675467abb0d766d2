"""Carries the regions of tracks into neighbouring photographs where they were missed."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from zpm2.carry import CarryResult
from zpm2.config import TracksConfig
from zpm2.model import Polygon
from zpm2.polygons.repair import largest
from zpm2.polygons.shapes import from_shape
from zpm2.tracking.join import Observation, Track, TrackMatch
from zpm2.tracking.matches import CarriedRegions

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Errand:
    """Regions of one photograph that are looked for in another."""

    source: int  # row of the photograph
    target: int
    tracks: tuple[int, ...]  # rows
    regions: tuple[Observation, ...]  # of each track, in the source

    @property
    def polygons(self) -> list[Polygon]:
        """The regions with ids that are rows."""
        return [Polygon(k, seen.polygon.exterior, seen.polygon.holes) for k, seen in enumerate(self.regions)]


def errands(tracks: Sequence[Track], strength: Mapping[Pair, int], config: TracksConfig) -> list[Errand]:
    """Where regions are looked for: in each photograph that was matched with one of their track and is not in it.

    A region comes from the photograph of its track that has most matches with the target: `strength`, by pair. Of more
    than `max_carried` for one errand, those of the longest tracks go, then the most confident ones.
    """
    neighbors = defaultdict[int, list[int]](list)
    for (i, j), count in sorted(strength.items()):
        if count:
            neighbors[i].append(j)
            neighbors[j].append(i)
    wanted = defaultdict[Pair, list[int]](list)
    for row, track in enumerate(tracks):
        views = set(track.views)
        for target in sorted({j for view in views for j in neighbors[view]} - views):
            sources = [view for view in neighbors[target] if view in views]
            best = max(sources, key=lambda view: (strength[min(view, target), max(view, target)], -view))
            wanted[best, target].append(row)
    made = []
    for (source, target), rows in sorted(wanted.items()):
        rows = sorted(rows, key=lambda row: (-len(tracks[row].views), -tracks[row].matches[0].confidence, row))
        rows = sorted(rows[: config.max_carried])
        made.append(Errand(source, target, tuple(rows), tuple(tracks[row].seen[source] for row in rows)))
    return made


def carried_regions(result: CarryResult) -> CarriedRegions:
    """What tracks need of a carried list of polygons: of several parts the largest."""
    outlines = [
        from_shape(largest(each.shape), row) for row, each in enumerate(result.outcomes) if each.shape is not None
    ]
    confidence = np.array([each.confidence for each in result.outcomes], np.float64)
    return CarriedRegions([each.status for each in result.outcomes], confidence, outlines)


def carried_matches(errand: Errand, found: CarriedRegions, pair: int, config: TracksConfig) -> list[TrackMatch]:
    """The carried outlines that are sure enough, as matches with the region they came from. `pair` is an index that no
    matched pair has."""
    return [
        TrackMatch(
            errand.regions[polygon.id],
            Observation(errand.target, pair, polygon),
            float(found.confidence[polygon.id]),
            carried=True,
        )
        for polygon in found.outlines
        if found.confidence[polygon.id] >= config.min_carried
    ]


def absent_in(tracks: Sequence[Track], done: Sequence[tuple[Errand, CarriedRegions]]) -> list[dict[int, str]]:
    """Of each track, the photographs in which it was looked for in vain, and why: `carry.Outcome.status`, or "unsure"
    for an outline that did not join it."""
    track_of = {_key(seen): row for row, track in enumerate(tracks) for seen in track.observations}
    found: list[dict[int, str]] = [{} for _ in tracks]
    for errand, carried in done:
        for seen, status in zip(errand.regions, carried.status, strict=True):
            row = track_of[_key(seen)]
            if errand.target not in tracks[row].views:
                found[row][errand.target] = status if status in ("outside", "hidden", "not found") else "unsure"
    return [dict(sorted(each.items())) for each in found]


def _key(seen: Observation) -> tuple[int, int, int]:
    """What no other observation has."""
    return seen.view, seen.pair, seen.polygon.id
