"""Regions followed through photographs on one screen: pairs -> matches -> tracks -> carried further -> tracks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from zpm2 import api
from zpm2 import config as configuration
from zpm2.config import Config
from zpm2.features import PointMatcher
from zpm2.files.keys import key
from zpm2.model.messages import Note, split
from zpm2.pipeline import matching_part, plugin_code
from zpm2.runtime import Progress, StageTimer, resolve_device
from zpm2.segment.protocol import Segmenter
from zpm2.tracking.events import Event, events
from zpm2.tracking.extend import Errand, absent_in, carried_matches, carried_regions, errands
from zpm2.tracking.join import Observation, Track, TrackMatch, build_tracks
from zpm2.tracking.matches import CarriedRegions, PairMatches, Store, pair_matches
from zpm2.tracking.pairs import Pair, choose_pairs
from zpm2.tracking.photographs import Photograph, read_photographs
from zpm2.tracking.result import PairSummary, RegionTrack, SeenRegion, TracksResult


def tracks(
    photographs: Sequence[str | Path] | str | Path,
    config: Config | str = "default",
    *,
    pairs: str | Path = "auto",
    segmenter: Segmenter | None = None,
    points: PointMatcher | None = None,
    matcher: "api.Matcher | None" = None,
    kept: str | Path | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> TracksResult:
    """Follow regions through photographs, ordered or not.

        found = zpm2.tracks("photos")
        found.save("out")

    photographs: files, or a folder. Their order does not matter: they are taken in the natural order of their names.
    pairs: which are matched with each other: "sequential" (neighbours in this order), "exhaustive", "colmap" (the pairs
    with verified matches in the database.db beside them), a database or a model of COLMAP, a list with two names a
    line, or "auto": by the positions that all of them have (EXIF, georeference), else by the points that they share.
    kept: a folder for finished pairs, of methods of the configuration: a run goes on from there if photographs,
    configuration and code are the same. The run also puts there, and removes in the end, what networks found in
    photographs that left the memory.

    segmenter, points, progress and say are those of `Matcher`. matcher: one of the same configuration, whose networks
    are loaded already, in place of a new one with these four; it forgets the photographs that it kept.
    `InputError` for photographs that cannot be read, that are fewer than two or given twice, and where no pair is left;
    `ConfigError` for `kept` with a segmenter or point matcher that is an object, also of `matcher`; other errors are
    those of `Matcher`.
    """
    chosen = configuration.as_config(config)
    own = segmenter is not None or points is not None or (matcher is not None and matcher.has_objects)
    if own and kept is not None:
        raise api.unnamed("kept pairs")
    timer = StageTimer(progress)
    given = [photographs] if isinstance(photographs, str | Path) else photographs
    with timer("read"):
        found = read_photographs(given, chosen.raster)
    with timer("choose"):
        way = choose_pairs(found, pairs, chosen, resolve_device(chosen.device), progress)
    store = Store(None if kept is None else Path(kept))
    with store.temporary() as aside:
        work = _Work(found, chosen, segmenter, points, store, aside, progress, say, matcher)
        with timer("match"):
            matched = work.matched(way.pairs)
        matches = [match for n, (pair, each) in enumerate(matched.items()) for match in _track_matches(n, pair, each)]
        with timer("join"):
            joined, _ = build_tracks(matches, chosen.tracks.same, votes=True)
        more = list[tuple[Errand, CarriedRegions]]()
        if chosen.tracks.extend:
            with timer("extend"):
                more = work.carried(errands(joined, {pair: len(m.left) for pair, m in matched.items()}, chosen.tracks))
            extended = enumerate(more, len(matched))
            matches += [match for n, (e, c) in extended for match in carried_matches(e, c, n, chosen.tracks)]
            joined, _ = build_tracks(matches, chosen.tracks.same, votes=True)
    if work.store.reused:
        say(f"{work.store.reused} finished pairs were taken from an earlier run")
    work.store.forget_others()
    numbered = _numbered(joined, absent_in(joined, more))
    with timer("events"):
        happened = _events(numbered, matched, len(found), chosen)
    messages = [*way.warnings, *work.messages]
    pair_names = {pair: " and ".join(found[row].name for row in pair) for pair in matched}
    messages += _told({pair_names[pair]: each.warnings for pair, each in matched.items()})
    messages += [Note(text) for text in _told({pair_names[pair]: each.notes for pair, each in matched.items()})]
    if not numbered:
        messages.append("no region was followed: no two photographs have a match")
    warnings, notes = split(messages)
    return TracksResult(
        photographs=found,
        tracks=numbered,
        events=happened,
        pairs=_summaries(matched, matches, joined),
        chosen=way.how,
        config=chosen.to_dict(),
        timings=timer.seconds,
        warnings=warnings,
        notes=notes,
    )


class _TakesNoPrompts(Exception):
    """A segmenter that cannot look for a region."""


class _Work:
    """Matches and carries pairs, or takes them from an earlier run. Networks are loaded when they are first needed."""

    def __init__(
        self,
        photographs: Sequence[Photograph],
        config: Config,
        segmenter: Segmenter | None,
        points: PointMatcher | None,
        store: Store,
        aside: Path | None,
        progress: Progress,
        say: Callable[[str], None],
        matcher: "api.Matcher | None" = None,
    ) -> None:
        self.photographs, self.config, self.store, self.aside = photographs, config, store, aside
        self.progress, self.say = progress, say
        self._segmenter, self._points = segmenter, points
        self.messages: list[str] = []
        self._matcher = matcher
        if matcher is not None:
            matcher.keep(config.tracks.looked_at, aside)

    def matched(self, pairs: Sequence[Pair]) -> dict[Pair, PairMatches]:
        """The matches of each pair, in their order."""
        found = {}
        for k, (i, j) in enumerate(pairs):
            self.progress("pairs", k / len(pairs))

            def match(i: int = i, j: int = j) -> PairMatches:
                result = self.matcher(self.photographs[i].path, self.photographs[j].path)
                return pair_matches(result, self.config.global_match)

            found[i, j] = self.store.get(self._key(i, j), PairMatches, match)
        self.progress("pairs", 1.0)
        return found

    def carried(self, wanted: Sequence[Errand]) -> list[tuple[Errand, CarriedRegions]]:
        """What became of the regions of each errand."""
        found = []
        for k, errand in enumerate(wanted):
            self.progress("carrying", k / len(wanted))

            def carry(errand: Errand = errand) -> CarriedRegions:
                source, target = (self.photographs[row].path for row in (errand.source, errand.target))
                matcher = self.matcher
                if not matcher.takes_prompts:
                    raise _TakesNoPrompts
                return carried_regions(matcher.carry(source, target, errand.polygons))

            outlines = [[ring.tolist() for ring in (each.exterior, *each.holes)] for each in errand.polygons]
            name = self._key(errand.source, errand.target, asdict(self.config.carry), outlines)
            try:
                found.append((errand, self.store.get(name, CarriedRegions, carry)))
            except _TakesNoPrompts:
                self.messages.append("the segmenter takes no prompts: regions were not carried further")
                return []
        self.progress("carrying", 1.0)
        return found

    @property
    def matcher(self) -> api.Matcher:
        """Matches and carries. The photographs that were used last are not looked at again."""
        if self._matcher is None:
            self._matcher = api.Matcher(
                self.config,
                segmenter=self._segmenter,
                points=self._points,
                progress=self.progress,
                say=self.say,
                photographs=self.config.tracks.looked_at,
                aside=self.aside,
            )
        return self._matcher

    def _key(self, i: int, j: int, *more: object) -> str:
        paths = [self.photographs[row].path for row in (i, j)]
        return key(paths, matching_part(self.config), *plugin_code(self.config), *more)


def _told(messages: Mapping[str, Sequence[str]]) -> list[str]:
    """The messages of pairs, by the pairs' names. What several have to say is said once."""
    by_text: dict[str, list[str]] = {}
    for name, texts in messages.items():
        for text in texts:
            by_text.setdefault(text, []).append(name)
    told = []
    for text, names in by_text.items():
        who = names[0] if len(names) == 1 else f"{len(names)} pairs"
        told.append(text if len(names) == len(messages) else f"{who}: {text}")
    return told


def _track_matches(index: int, pair: Pair, found: PairMatches) -> list[TrackMatch]:
    return [
        TrackMatch(Observation(pair[0], index, left), Observation(pair[1], index, right), float(confidence))
        for left, right, confidence in zip(found.left, found.right, found.confidence, strict=True)
    ]


def _numbered(joined: Sequence[Track], absent: Sequence[Mapping[int, str]]) -> list[RegionTrack]:
    """The tracks by their first photograph, there from top to bottom and from left to right."""
    found = []
    for track, missing in zip(joined, absent, strict=True):
        seen = {}
        for row, observation in sorted(track.seen.items()):
            own = [match for match in track.matches if row in (match.left.view, match.right.view)]
            carried = all(match.carried for match in own)
            confidence = max(match.confidence for match in own if match.carried == carried)
            seen[row] = SeenRegion(observation.polygon, confidence, carried)
        found.append(RegionTrack(0, seen, missing, len(track.matches) - len(seen) + 1))
    found.sort(key=lambda track: (next(iter(track.seen)), track.center[::-1]))
    return [_with_id(track, id) for id, track in enumerate(found, start=1)]


def _with_id(track: RegionTrack, id: int) -> RegionTrack:
    seen = {row: replace(each, polygon=replace(each.polygon, id=id, parent=None)) for row, each in track.seen.items()}
    return replace(track, id=id, seen=seen)


def _events(
    found: Sequence[RegionTrack], matched: Mapping[Pair, PairMatches], count: int, config: Config
) -> list[Event]:
    seen = {row: {track.id: track.seen[row].polygon for track in found if row in track.seen} for row in range(count)}
    happened = (events(seen, pair, each, config.tracks, config.local_match) for pair, each in matched.items())
    return [event for each in happened for event in each]


def _summaries(
    matched: Mapping[Pair, PairMatches], matches: Sequence[TrackMatch], joined: Sequence[Track]
) -> list[PairSummary]:
    used = {id(match) for track in joined for match in track.matches}
    found = []
    for pair, each in matched.items():
        own = [m for m in matches if (min(m.left.view, m.right.view), max(m.left.view, m.right.view)) == pair]
        carried = sum(match.carried and id(match) in used for match in own)
        left_out = sum(not match.carried and id(match) not in used for match in own)
        found.append(PairSummary(*pair, len(each.left), left_out, carried))
    return found
