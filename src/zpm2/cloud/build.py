"""The polygon cloud on one screen: lift both views of every match -> cross-check -> tracks -> one patch each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.check import Agreement, cross_check
from zpm2.cloud.lift import Lifted, lift
from zpm2.cloud.patch import Cutter, Patch, shares
from zpm2.cloud.rays import RayCaster
from zpm2.cloud.result import CloudPatch, PolygonCloud, Rejected, Support
from zpm2.cloud.seen import Seen
from zpm2.cloud.surface import Surface
from zpm2.cloud.tracks import Link, Sighting, Track, chain
from zpm2.cloud.workspace import View
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import PosedCamera
from zpm2.model.messages import Note, about, split
from zpm2.result import MatchResult
from zpm2.runtime import StageTimer

Array = NDArray[np.float64]
INSIDE = 0.9  # of a part's area lies in its whole


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """Two views and their matches."""

    left: int  # index of the view
    right: int
    result: MatchResult


def build(
    views: Sequence[View],
    pairs: Sequence[MatchedPair],
    surface: Surface,
    caster: RayCaster,
    config: CloudConfig,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> PolygonCloud:
    """The polygon cloud of matched pairs of views.

    Every reason why a match gave no patch is in `rejected`. Warnings say what should be known about the mesh. An empty
    cloud is a result, with warnings that say why; `InputError` where no view sees the mesh.
    """
    clock = StageTimer(progress)
    cameras = [view.camera for view in views]
    seen = Seen(surface, caster, cameras)
    said = about("mesh", surface.notes) + ([caster.note] if caster.note else [])
    said += seen.warnings([view.name for view in views])
    rejected: list[Rejected] = []
    found: dict[Link, tuple[Support, dict[Sighting, Lifted]]] = {}
    with clock("lift"):
        for k, pair in enumerate(pairs):
            ends = cameras[pair.left], cameras[pair.right]
            accepted, refused = _lifted(k, pair, ends, surface, caster, config)
            found |= accepted
            rejected += refused
            progress("lift", (k + 1) / len(pairs))
    with clock("tracks"):
        tracks, contradicted = chain(list(found), config.same)
    if contradicted:
        said.append(Note(f"{contradicted} matches contradict surer ones through other views, and were left out"))
        kept = {link for track in tracks for link in track.links}
        why = "surer matches of other views say another region"
        rejected += [_refused(support, why) for link, (support, _) in found.items() if link not in kept]
    with clock("cut"):
        patches, refused = _patches(tracks, found, surface, cameras, config)
        rejected += refused
    matches = sum(len(pair.result.matches) for pair in pairs)
    if not patches:
        said.append(f"no polygon could be lifted, of {matches} matches")
    warnings, notes = split(said)
    return PolygonCloud(
        views=views,
        surface=surface,
        patches=patches,
        rejected=rejected,
        matches=matches,
        coverage=seen.covered([patch.patch for patch in patches]),
        config={},
        timings=clock.seconds,
        warnings=warnings,
        notes=notes,
    )


def _lifted(
    index: int,
    pair: MatchedPair,
    cameras: tuple[PosedCamera, PosedCamera],
    surface: Surface,
    caster: RayCaster,
    config: CloudConfig,
) -> tuple[dict[Link, tuple[Support, dict[Sighting, Lifted]]], list[Rejected]]:
    """The matches of a pair that both views confirm, with their lifted polygons, and the others."""
    left, right = pair.result.matched_polygons()
    lifts = [lift(side, camera, surface, caster, config) for side, camera in zip((left, right), cameras, strict=True)]
    both = list(zip(*lifts, strict=True))
    said = cross_check(list(zip(left, right, strict=True)), both, cameras, surface, caster, config)
    accepted, refused = {}, []
    for match, polygons, pieces, agreement in zip(
        pair.result.matches, zip(left, right, strict=True), both, said, strict=True
    ):
        ends = pair.left, pair.right, match.left, match.right
        fault = str(agreement) if isinstance(agreement, Failed) else agreement.fault(config)
        if fault:
            refused.append(Rejected(*ends, fault))
            continue
        assert isinstance(agreement, Agreement)
        sightings = Sighting(pair.left, index, polygons[0]), Sighting(pair.right, index, polygons[1])
        link = Link(*sightings, match.confidence)
        on_surface = {s: piece for s, piece in zip(sightings, pieces, strict=True) if isinstance(piece, Lifted)}
        accepted[link] = Support(*ends, match.confidence, agreement.overlap, agreement.distance), on_surface
    return accepted, refused


def _patches(
    tracks: Sequence[Track],
    found: Mapping[Link, tuple[Support, Mapping[Sighting, Lifted]]],
    surface: Surface,
    cameras: Sequence[PosedCamera],
    config: CloudConfig,
) -> tuple[list[CloudPatch], list[Rejected]]:
    """A patch for each track, from the view that shows most of it; those of one place are one."""
    chosen: list[tuple[Track, Sighting, Lifted]] = []
    for track in tracks:
        choice = {s: piece for link in track.links for s, piece in found[link][1].items()}
        best = max(choice, key=lambda s: choice[s].scale ** 2 * s.polygon.area)
        chosen.append((track, best, choice[best]))
    made: list[CloudPatch] = []
    rejected = []
    cutter: Cutter | None = None
    for track, sighting, lifted in sorted(chosen, key=lambda c: c[1].view):  # one view's pixels at a time
        if cutter is None or cutter.view is not cameras[sighting.view]:
            cutter = Cutter(surface, cameras[sighting.view])
        patch = cutter.cut(lifted)
        supports = tuple(found[link][0] for link in track.links)
        if isinstance(patch, Failed):
            rejected += [_refused(support, patch.reason) for support in supports]
            continue
        hole = patch.source >= len(surface.faces) - surface.filled
        filled = float(patch.areas[hole].sum() / patch.area)
        made.append(
            CloudPatch(
                id=0,
                patch=patch,
                rings=lifted.rings,
                view=sighting.view,
                polygon=sighting.polygon,
                scale=lifted.scale,
                bridged=lifted.bridged,
                views=tuple(track.views),
                supports=supports,
                filled=filled,
            )
        )
    made = _merged(made, surface, cameras, config.same)
    made.sort(key=lambda p: -p.patch.area)  # parts come after their wholes
    return _nested([replace(patch, id=k) for k, patch in enumerate(made)], surface, cameras), rejected


def _merged(
    patches: list[CloudPatch], surface: Surface, cameras: Sequence[PosedCamera], same: float
) -> list[CloudPatch]:
    """Patches of different tracks that cover one another are one region that the matches did not join: the one that
    more views see stays, and takes the supports of the others. Two regions of one view stay two."""
    order = sorted(patches, key=lambda p: (-len(p.views), -p.scale, -p.patch.area))
    near = _meeting([p.patch for p in order], surface)
    gone: set[int] = set()
    kept = []
    for a, patch in enumerate(order):
        if a in gone:
            continue
        own = patch.outline(cameras[patch.view], surface)
        for b in sorted(near.get(a, [])):
            other = order[b]
            if b < a or b in gone or set(patch.views) & set(other.views):
                continue
            there = other.outline(cameras[patch.view], surface)
            both = own.intersection(there).area
            if both >= same * (own.area + there.area - both) and both > 0:
                gone.add(b)
                supports = sorted((*patch.supports, *other.supports), key=lambda s: -s.confidence)
                views = tuple(sorted({*patch.views, *other.views}))
                patch = replace(patch, supports=tuple(supports), views=views)
        kept.append(patch)
    return kept


def _nested(patches: list[CloudPatch], surface: Surface, cameras: Sequence[PosedCamera]) -> list[CloudPatch]:
    """Each patch with the smallest one that holds nine tenths of it, as its view sees them. Patches come by descending
    area."""
    near = _meeting([p.patch for p in patches], surface)
    level: dict[int, int] = {}
    result = []
    for k, patch in enumerate(patches):
        camera = cameras[patch.view]
        own = patch.outline(camera, surface)
        larger = sorted((j for j in near.get(k, []) if j < k), reverse=True)
        parent = next(
            (j for j in larger if own.intersection(patches[j].outline(camera, surface)).area >= INSIDE * own.area),
            None,
        )
        level[k] = 0 if parent is None else level[parent] + 1
        result.append(replace(patch, parent=parent, level=level[k]))
    return result


def _meeting(patches: Sequence[Patch], surface: Surface) -> dict[int, list[int]]:
    """By patch, those that have a triangle of the surface in common with it."""
    covers = shares(patches, surface)
    meeting = (covers @ covers.T).tocoo()
    near: dict[int, list[int]] = {}
    for a, b in zip(meeting.row.tolist(), meeting.col.tolist(), strict=True):
        if a != b:
            near.setdefault(a, []).append(b)
    return near


def _refused(support: Support, reason: str) -> Rejected:
    return Rejected(support.left_view, support.right_view, support.left_polygon, support.right_polygon, reason)
