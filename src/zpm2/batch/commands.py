"""What is done with each pair: match, pose, carry, or a class of your own at a dotted path; and tracks of groups."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar, cast

from zpm2.api import Matcher
from zpm2.batch.entries import Entry, Group, Pair, TileEntry
from zpm2.batch.job import Job
from zpm2.batch.results import results_in
from zpm2.batch.tables import Columns, Value
from zpm2.errors import Failed, Zpm2Error
from zpm2.photos.source import ImageLike
from zpm2.plugins import value_at
from zpm2.pose import PoseFinder, PoseResult, find
from zpm2.result import MatchResult
from zpm2.runtime import resolve_device
from zpm2.tracking import tracks
from zpm2.tracking.matches import KEPT
from zpm2.tracking.result import SHEETS


@dataclass(frozen=True, eq=False)
class Finished:
    """The result of a pair, or of a group."""

    write: Callable[[Path], object]  # its files, into a folder
    found: Mapping[str, Value]  # its row of the index, by the columns of the command
    seconds: float


E = TypeVar("E", contravariant=True)
T = TypeVar("T")


class Command(Protocol[E]):
    """What is done with each entry of a list."""

    @property
    def columns(self) -> Columns:
        """What the index says of an entry: names and kinds."""
        ...

    def results(self, entries: Iterable[E], /) -> Iterator[Finished | Zpm2Error]:
        """One for each entry, in their order; an error for one that has no result. What is raised is wrong with the
        entry after the last result, or, a `Zpm2Error` before any entry was taken, with all."""
        ...


def one_by_one(entries: Iterable[T], do: Callable[[T], Finished]) -> Iterator[Finished | Zpm2Error]:
    """What `do` makes of each entry, or its error, as `Command.results` gives them."""
    for entry in entries:
        try:
            yield do(entry)
        except Zpm2Error as error:
            yield error


PairCommand = Command[Pair]  # a class of this form, made with a `Job`, may be given as package.module:Class


MATCH: Columns = {
    "left_polygons": "int",
    "right_polygons": "int",
    "points": "int",
    "matches": "int",
    "mean_confidence": "float",
    "same_scene": "float",
    "warnings": "int",
}
POSE: Columns = {
    **MATCH,
    "used": "int",
    "inliers": "int",
    "rotation": "floats",  # row by row
    "translation": "floats",
    "flags": "text",
}
CARRY: Columns = {"regions": "int", "found": "int", "in_part": "int", "mean_confidence": "float", "warnings": "int"}
TRACKS: Columns = {"pairs": "int", "tracks": "int", "in_three": "int", "events": "int", "warnings": "int"}


class Match:
    """The polygons of each pair, as by `zpm2 match`."""

    columns = MATCH

    def __init__(self, job: Job) -> None:
        self.job = job
        self.matcher = Matcher(job.config, photographs=job.photographs)

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        """See `Command`."""
        for _, found in self.matched(pairs):
            yield found if isinstance(found, Zpm2Error) else self.finished(found)

    def matched(self, pairs: Iterable[Pair]) -> Iterator[tuple[Pair, MatchResult | Zpm2Error]]:
        """Each pair with its matches."""
        taken = deque[Pair]()

        def photographs() -> Iterator[tuple[ImageLike, ImageLike]]:
            for pair in pairs:
                taken.append(pair)
                yield pair.left, pair.right

        for found in self.matcher.match_many(photographs(), at_once=self.job.at_once, photographs=self.job.photographs):
            yield taken.popleft(), found

    def finished(self, result: MatchResult) -> Finished:
        """A result with what the index says of it."""
        confidences = [match.confidence for match in result.matches]
        found: dict[str, Value] = {
            "left_polygons": len(result.left.polygons),
            "right_polygons": len(result.right.polygons),
            "points": len(result.points),
            "matches": len(confidences),
            "mean_confidence": round(sum(confidences) / len(confidences), 4) if confidences else None,
            "same_scene": None if result.same_scene is None else round(result.same_scene, 4),
            "warnings": len(result.warnings),
        }
        job = self.job
        seconds = sum(result.timings.values())
        return Finished(lambda folder: result.save(folder, job.formats, job.report, job.pictures), found, seconds)


class Pose(Match):
    """Matches and the relative pose of each pair, as by `zpm2 pose`. No pose is a result, too."""

    columns = POSE

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self.finder = PoseFinder(job.config, device=resolve_device(job.config.device))

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        """See `Command`."""
        for pair, result in self.matched(pairs):
            try:
                yield result if isinstance(result, Zpm2Error) else self.posed(pair, result)
            except Zpm2Error as error:
                yield error

    def posed(self, pair: Pair, result: MatchResult) -> Finished:
        """Matches with their pose."""
        made = find(
            pair.left,
            pair.right,
            self.job.config,
            k=pair.k,
            k2=pair.k2,
            centers=self.job.centers,
            match=lambda left, right: result,
            finder=self.finder,
        )
        matched, posed = self.finished(result), made.pose

        def write(folder: Path) -> None:
            matched.write(folder)
            made.save(folder)

        return Finished(write, {**matched.found, **_pose(posed)}, matched.seconds + sum(posed.timings.values()))


class Carry:
    """The given regions of each left photograph in the right one, as by `zpm2 carry`."""

    columns = CARRY

    def __init__(self, job: Job) -> None:
        self.job = job
        self.matcher = Matcher(job.config, photographs=job.photographs)

    def results(self, pairs: Iterable[Pair]) -> Iterator[Finished | Zpm2Error]:
        """See `Command`."""
        return one_by_one(pairs, self.carried)

    def carried(self, pair: Pair) -> Finished:
        """The regions of a pair."""
        result = self.matcher.carry(pair.left, pair.right, pair.regions or (), rigid=self.job.rigid)
        seen = [outcome.confidence for outcome in result.outcomes if outcome.shape is not None]
        counts = result.counts()
        found: dict[str, Value] = {
            "regions": len(result.regions),
            "found": counts.get("found", 0),
            "in_part": counts.get("in part", 0),
            "mean_confidence": round(sum(seen) / len(seen), 4) if seen else None,
            "warnings": len(result.warnings),
        }
        report = self.job.report
        return Finished(lambda folder: result.save(folder, report=report), found, sum(result.timings.values()))


class Tracks:
    """Regions followed through the photographs of each group, as by `zpm2 tracks`. No track is a result, too.

    Finished pairs of photographs stay in the folder of the group, from which its next try goes on.
    """

    columns = TRACKS

    def __init__(self, job: Job) -> None:
        self.job = job
        self.matcher = Matcher(job.config)
        self.folders = results_in(job.out, job.kind)

    def results(self, groups: Iterable[Group]) -> Iterator[Finished | Zpm2Error]:
        """See `Command`."""
        return one_by_one(groups, self.followed)

    def followed(self, group: Group) -> Finished:
        """The tracks of a group."""
        job, folder = self.job, self.folders.folder(group.name)
        kept = None if folder is None else folder / KEPT
        result = tracks(group.photographs, job.config, pairs=job.way, matcher=self.matcher, kept=kept)
        found: dict[str, Value] = {
            "pairs": len(result.pairs),
            "tracks": len(result.tracks),
            "in_three": sum(count for photographs, count in result.lengths().items() if photographs >= 3),
            "events": len(result.events),
            "warnings": len(result.warnings),
        }
        sheets = SHEETS if job.pictures else 0
        return Finished(lambda folder: result.save(folder, sheets, job.report), found, sum(result.timings.values()))


def command_of(job: Job) -> Command[Entry | TileEntry]:
    """The command of a job, ready for work; its models are loaded when the first pair comes. It is given entries
    of its own kind (`Job.kind`)."""
    own = value_at(job.command, "command") if ":" in job.command else _BUILT_IN[job.command]
    return cast(Command[Entry | TileEntry], own(job))


def columns_of(job: Job) -> Columns:
    """What the index says of an entry beside that which it says of all."""
    own = value_at(job.command, "command") if ":" in job.command else _BUILT_IN[job.command]
    return cast(Columns, own.columns)


def _pose(result: PoseResult) -> dict[str, Value]:
    counts, pose, shift = result.counts(), result.pose, result.translation
    return {
        "used": counts["used"],
        "inliers": counts["inliers"],
        "rotation": None if isinstance(pose, Failed) else [float(v) for v in pose.rotation.ravel()],
        "translation": None if shift is None else [float(v) for v in shift],
        "flags": f"failed: {pose}" if isinstance(pose, Failed) else " ".join(pose.flags),
    }


_BUILT_IN: dict[str, type[Match | Pose | Carry | Tracks]] = {
    "match": Match,
    "pose": Pose,
    "carry": Carry,
    "tracks": Tracks,
}
