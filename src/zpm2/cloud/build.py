"""The polygon cloud on one screen: lift both polygons of each match -> cross-check -> tracks -> one patch per track."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from zpm2.cloud.check import Agreement, cross_check
from zpm2.cloud.coverage import Coverage
from zpm2.cloud.events import surface_events
from zpm2.cloud.lift import Lifted, lift
from zpm2.cloud.patch import Cutter, touching
from zpm2.cloud.rays import RayCaster
from zpm2.cloud.result import CloudPatch, PolygonCloud, Rejected, SupportingMatch
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.surface_view import SurfaceView
from zpm2.cloud.workspace import PosedPhotograph
from zpm2.config import CloudConfig, TracksConfig
from zpm2.errors import Failed
from zpm2.model.messages import Note, about, split
from zpm2.result import MatchResult
from zpm2.runtime import StageTimer
from zpm2.tracking.join import Observation, Track, TrackMatch, build_tracks

TRACKS = TracksConfig()
Accepted = dict[TrackMatch, tuple[SupportingMatch, dict[Observation, Lifted]]]  # by match; with its lifted polygons


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """Two views and their matches."""

    left: int  # index of the view
    right: int
    result: MatchResult


def build(
    views: Sequence[PosedPhotograph],
    pairs: Sequence[MatchedPair],
    surface: SurfaceMesh,
    caster: RayCaster,
    config: CloudConfig,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    tracks_config: TracksConfig = TRACKS,
) -> PolygonCloud:
    """The polygon cloud of matched pairs of views. `tracks_config` says what a split is.

    Matches that give no patch are listed in `rejected`, each with its reason. A cloud may be empty; its warnings then
    say why. `InputError` if no view sees the mesh.
    """
    timer = StageTimer(progress)
    on_mesh = [SurfaceView(view.camera, surface, caster) for view in views]
    coverage = Coverage(on_mesh, config.coverage_rays)
    messages = about("mesh", surface.notes) + ([caster.note] if caster.note else [])
    messages += coverage.warnings([view.name for view in views])
    rejected: list[Rejected] = []
    found: Accepted = {}
    with timer("lift"):
        for k, pair in enumerate(pairs):
            accepted, refused = _lifted(k, pair, (on_mesh[pair.left], on_mesh[pair.right]), config)
            found |= accepted
            rejected += refused
            progress("lift", (k + 1) / len(pairs))
    with timer("tracks"):
        tracks, contradicted = build_tracks(list(found), config.same)
    if contradicted:
        messages.append(
            Note(f"{contradicted} matches were left out: they contradict more confident matches through other views")
        )
        kept = {match for track in tracks for match in track.matches}
        why = "it contradicts more confident matches of other views"
        rejected += [_rejected(support, why) for match, (support, _) in found.items() if match not in kept]
    with timer("cut"):
        patches, refused = _patches(tracks, found, on_mesh, config)
        rejected += refused
    with timer("events"):
        happened = surface_events(patches, on_mesh, [(pair.left, pair.right) for pair in pairs], tracks_config)
    matches = sum(len(pair.result.matches) for pair in pairs)
    if not patches:
        messages.append(f"none of the {matches} matches gave a polygon on the surface")
    warnings, notes = split(messages)
    return PolygonCloud(
        views=views,
        surface=surface,
        patches=patches,
        rejected=rejected,
        matches=matches,
        coverage=coverage.of([patch.patch for patch in patches]),
        config={},
        timings=timer.seconds,
        warnings=warnings,
        notes=notes,
        events=happened,
    )


def _lifted(
    index: int, pair: MatchedPair, views: tuple[SurfaceView, SurfaceView], config: CloudConfig
) -> tuple[Accepted, list[Rejected]]:
    """Splits a pair's matches: those that both views confirm, with their lifted polygons, and the rejected ones."""
    left, right = pair.result.matched_polygons()
    polygons = list(zip(left, right, strict=True))
    lifted = list(zip(lift(left, views[0], config), lift(right, views[1], config), strict=True))

    agreements = cross_check(polygons, lifted, views, config)
    accepted: Accepted = {}
    refused = []
    for match, ends, pieces, agreement in zip(pair.result.matches, polygons, lifted, agreements, strict=True):
        ids = pair.left, pair.right, match.left, match.right
        objection = str(agreement) if isinstance(agreement, Failed) else agreement.objection(config)
        if objection:
            refused.append(Rejected(*ids, objection))
            continue
        assert isinstance(agreement, Agreement)
        seen = Observation(pair.left, index, ends[0]), Observation(pair.right, index, ends[1])
        on_surface = {s: piece for s, piece in zip(seen, pieces, strict=True) if isinstance(piece, Lifted)}
        support = SupportingMatch(*ids, match.confidence, agreement.overlap, agreement.distance)
        accepted[TrackMatch(*seen, match.confidence)] = support, on_surface
    return accepted, refused


def _patches(
    tracks: Sequence[Track], found: Accepted, views: Sequence[SurfaceView], config: CloudConfig
) -> tuple[list[CloudPatch], list[Rejected]]:
    """One patch per track, cut in the view that shows most of the region. Patches of the same place are merged."""
    surface = views[0].surface
    chosen: list[tuple[Track, Observation, Lifted]] = []
    for track in tracks:
        choice = {s: piece for match in track.matches for s, piece in found[match][1].items()}
        best = max(choice, key=lambda s: choice[s].scale ** 2 * s.polygon.area)
        chosen.append((track, best, choice[best]))
    made: list[CloudPatch] = []
    rejected = []
    cutter: Cutter | None = None
    for track, observation, lifted in sorted(chosen, key=lambda c: c[1].view):  # one view's pixels at a time
        camera = views[observation.view].camera
        if cutter is None or cutter.camera is not camera:
            cutter = Cutter(surface, camera)
        patch = cutter.cut(lifted)
        supports = tuple(found[match][0] for match in track.matches)
        if isinstance(patch, Failed):
            rejected += [_rejected(support, patch.reason) for support in supports]
            continue
        hole = patch.source >= len(surface.faces) - surface.filled
        filled = float(patch.areas[hole].sum() / patch.area)
        made.append(
            CloudPatch(
                id=0,
                patch=patch,
                rings=lifted.rings,
                view=observation.view,
                polygon=observation.polygon,
                scale=lifted.scale,
                bridged=lifted.bridged,
                views=tuple(track.views),
                supports=supports,
                filled=filled,
            )
        )
    made = _merged(made, views, config.same)
    made.sort(key=lambda p: -p.patch.area)  # parts come after their wholes
    return _nested([replace(patch, id=k) for k, patch in enumerate(made)], views, config.nested), rejected


def _merged(patches: list[CloudPatch], views: Sequence[SurfaceView], same: float) -> list[CloudPatch]:
    """Merges patches of different tracks that cover each other: they show one region, but no match joined them.

    The patch that most views see stays and takes over the supporting matches of the others. Two regions of the same
    view are never merged.
    """
    surface = views[0].surface
    order = sorted(patches, key=lambda p: (-len(p.views), -p.scale, -p.patch.area))
    near = touching([p.patch for p in order], surface)
    gone: set[int] = set()
    kept = []
    for a, patch in enumerate(order):
        if a in gone:
            continue
        camera = views[patch.view].camera
        own = patch.outline(camera, surface)
        for b in sorted(near.get(a, [])):
            other = order[b]
            if b < a or b in gone or set(patch.views) & set(other.views):
                continue
            there = other.outline(camera, surface)
            both = own.intersection(there).area
            if both >= same * (own.area + there.area - both) and both > 0:
                gone.add(b)
                supports = sorted((*patch.supports, *other.supports), key=lambda s: -s.confidence)
                seen_by = tuple(sorted({*patch.views, *other.views}))
                patch = replace(patch, supports=tuple(supports), views=seen_by)
        kept.append(patch)
    return kept


def _nested(patches: list[CloudPatch], views: Sequence[SurfaceView], share: float) -> list[CloudPatch]:
    """Sets the parent of each patch: the smallest larger patch that covers at least `share` of it in its view.

    `patches` must be sorted by descending area.
    """
    surface = views[0].surface
    near = touching([p.patch for p in patches], surface)
    level: dict[int, int] = {}
    result = []
    for k, patch in enumerate(patches):
        camera = views[patch.view].camera
        own = patch.outline(camera, surface)
        larger = sorted((j for j in near.get(k, []) if j < k), reverse=True)
        parent = next(
            (j for j in larger if own.intersection(patches[j].outline(camera, surface)).area >= share * own.area),
            None,
        )
        level[k] = 0 if parent is None else level[parent] + 1
        result.append(replace(patch, parent=parent, level=level[k]))
    return result


def _rejected(support: SupportingMatch, reason: str) -> Rejected:
    return Rejected(support.left_view, support.right_view, support.left_polygon, support.right_polygon, reason)
