"""Predictions of a data set, one folder for each pair: an interrupted run continues, and scores need no models."""

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError, Zpm2Error
from zpm2.evaluate.pairs import EvalPair, PoseTruth
from zpm2.files.keys import code, key
from zpm2.files.photo_paths import has_content
from zpm2.files.reading import WRONG, read_json
from zpm2.files.record import make_folder, remove_own, save_key, saved_key
from zpm2.files.writing import atomic_write, claim, output_folder
from zpm2.formats.convert import Members
from zpm2.pose import PoseResult
from zpm2.result import MatchResult
from zpm2.runtime import package_version

T = TypeVar("T")
RUN, PREDICTIONS = "run.json", "predictions"
MatchPair = Callable[[EvalPair], MatchResult]
RESULTS = ("matches.json", "pose.json", "memory.json")
FindPose = Callable[[EvalPair, MatchResult], PoseResult | None]


@dataclass(frozen=True)
class PredictionSettings:
    """What a folder of predictions was made with. Runs that differ do not mix in one folder."""

    dataset: str
    split: str | None
    method: str
    config: Mapping[str, object]
    regions: str | None = None  # the folder of the evaluation whose polygons it took
    version: str = field(default_factory=package_version)
    code: str = field(default_factory=code)  # a hash of the package's source, and of its plug-ins'

    def claim(self, out: Path) -> None:
        """Make `out` the folder of this run, or continue in it; `InputError` if it holds predictions of another run."""
        file = claim(out, [RUN]) / RUN
        mine = {**vars(self), "config": json.loads(json.dumps(self.config))}
        if not file.exists():
            atomic_write(file, json.dumps(mine, indent=1))
            return
        theirs = _read_json(file)
        differ = [name for name in mine if theirs.get(name) != mine[name]]
        if differ:
            raise InputError(f"{out} holds predictions with another {', '.join(differ)}; give another folder with -o")


def folder_of(pair: EvalPair, out: Path) -> Path:
    """Where the prediction of a pair is kept."""
    return out / PREDICTIONS / pair.name


def predict(
    pairs: Iterable[EvalPair],
    matcher: Callable[[], MatchPair],
    out: Path,
    tell: Callable[[str], None],
    find_pose: FindPose = lambda pair, result: None,
    regions: Path | None = None,
) -> None:
    """Match every pair that has no prediction in `out` yet, or one of other photographs. `matcher` is called once, if
    there is anything to do, and `find_pose` for each result; its pose is kept too. `regions` is the folder of the
    evaluation whose polygons are used.

    A pair whose photographs cannot be read is remembered as failed, with the reason, and tried again by the next run.
    `matches.json` is written last, so an interruption loses the pair in work and nothing else.
    """
    match: MatchPair | None = None
    make_folder(claim(out, [PREDICTIONS]) / PREDICTIONS)
    for pair in pairs:
        folder, made_from = folder_of(pair, out), _made_from(pair, regions)
        if (folder / "matches.json").exists() and saved_key(folder) == made_from:
            continue
        match = match or matcher()
        try:
            result = match(pair)
            pose = find_pose(pair, result)
            if pose is not None:
                pose.save(folder)
            result.save(folder)
        except InputError as error:
            for name in RESULTS:  # of other photographs
                remove_own(folder / name)
            atomic_write(output_folder(folder) / "failed.json", json.dumps({"reason": str(error)}))
            tell(f"{pair.name}: {error}")
            continue
        remove_own(folder / "failed.json")
        atomic_write(folder / "memory.json", json.dumps({"peak_mb": peak_mb()}))
        save_key(folder, made_from)
        tell(pair.name)


def _made_from(pair: EvalPair, regions: Path | None) -> str:
    """The key of what a prediction depends on, beside what `PredictionSettings` holds."""
    cameras = [m.tolist() for m in pair.truth.intrinsics] if isinstance(pair.truth, PoseTruth) else None
    files = [pair.left, pair.right, *([] if regions is None else [folder_of(pair, regions) / "matches.json"])]
    return key(files, cameras)


def load(pair: EvalPair, out: Path) -> MatchResult | str | None:
    """The prediction of a pair, the reason why it failed, or None where there is none yet."""
    folder = folder_of(pair, out)
    if (folder / "matches.json").exists():
        try:
            return MatchResult.load(folder)
        except Zpm2Error as error:
            return str(error)
    if (folder / "failed.json").exists():
        return _taken(folder / "failed.json", lambda values: str(values["reason"]))
    return None


def is_current(pair: EvalPair, out: Path) -> bool:
    """Whether the prediction of a pair is of the photographs that it has now."""

    def same(document: Members) -> bool:
        sides = (document["left"], pair.left), (document["right"], pair.right)
        return all(has_content(side, file) for side, file in sides)

    return _taken(folder_of(pair, out) / "matches.json", same)


@dataclass(frozen=True)
class PredictedPose:
    """What the evaluation needs of a `pose.json`."""

    motion: tuple[NDArray[np.float64], NDArray[np.float64] | None] | None  # R (3, 3), t (3,); None where there is none
    flags: str  # reasons to doubt it, separated by spaces
    used: int  # points
    inliers: int
    seconds: float


def load_pose(pair: EvalPair, out: Path) -> PredictedPose | None:
    """The pose of a pair, where one was predicted."""
    file = folder_of(pair, out) / "pose.json"
    return _taken(file, _pose) if file.exists() else None


def memory(pair: EvalPair, out: Path) -> float | None:
    """MB, the peak of the process after this pair (models and earlier pairs counted in), where it was recorded."""
    file = folder_of(pair, out) / "memory.json"
    return _taken(file, lambda values: _number(values["peak_mb"])) if file.exists() else None


def peak_mb() -> int | None:
    """MB, the largest resident size that this process has had; None on Windows, which does not tell it this way."""
    if sys.platform == "win32":
        return None
    import resource

    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size // (1024 * 1024 if sys.platform == "darwin" else 1024)


def _pose(values: Members) -> PredictedPose:
    found, flags, counts = None, "failed", values["counts"]
    if (motion := values["pose"]) is not None:
        shift = motion["translation"]
        turn = np.array(motion["rotation"], np.float64).reshape(3, 3)
        found = turn, None if shift is None else np.array(shift, np.float64).reshape(3)
        flags = " ".join(motion["flags"])
    seconds = sum(float(each) for each in values["timings"].values())
    return PredictedPose(found, flags, int(counts["used"]), int(counts["inliers"]), seconds)


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)


def _taken(file: Path, take: Callable[[Members], T]) -> T:
    """`take` of the object in a JSON file; `InputError` where it lacks something."""
    try:
        return take(_read_json(file))
    except WRONG as error:
        raise InputError(f"{file} is damaged ({error!r}); delete it and run again") from error


def _read_json(file: Path) -> Members:
    try:
        values = read_json(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read ({error}); delete it and run again") from error
    if not isinstance(values, dict):
        raise InputError(f"{file} is damaged; delete it and run again")
    return values
