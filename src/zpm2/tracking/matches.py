"""The matches of one pair, and what a run keeps of finished pairs so that the next one goes on from there."""

import gzip
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.errors import Failed, InputError, OutputError
from zpm2.files.reading import WRONG, parse_json, unpack_gzip
from zpm2.files.record import HIDDEN, remove_own, temporary_folder
from zpm2.files.writing import atomic_write, claim, why
from zpm2.formats.convert import Converter, Layout
from zpm2.formats.document import LAYOUTS
from zpm2.model import PointMatches, Polygon
from zpm2.result import MatchResult

KEPT = f"{HIDDEN}/pairs"  # in the output folder, of finished pairs


@dataclass(frozen=True, eq=False)
class PairMatches:
    """The matched polygons of a pair, row k of all three, and the points that agree on its geometry."""

    left: Sequence[Polygon]
    right: Sequence[Polygon]
    confidence: NDArray[np.float64]  # (n,) 0..1
    points: PointMatches  # image px
    homography: NDArray[np.float64] | None  # (3, 3) right ~ H left; None: not known
    warnings: Sequence[str]
    notes: Sequence[str]


@dataclass(frozen=True, eq=False)
class CarriedRegions:
    """What became of regions that were carried from one photograph to another, row k of both."""

    status: Sequence[str]  # `carry.Outcome.status`
    confidence: NDArray[np.float64]  # (n,) 0..1
    outlines: Sequence[Polygon]  # those that were seen; ids are rows


def pair_matches(result: MatchResult, config: GlobalConfig) -> PairMatches:
    """What tracks need of the matches of a pair."""
    left, right = result.matched_polygons()
    points, matrix = result.points, result.homography
    if not isinstance(result.fundamental, Failed):
        points = points[geometry.epipolar_inliers(result.fundamental, points.left, points.right, config.epipolar_px)]
    return PairMatches(
        left,
        right,
        np.array([match.confidence for match in result.matches], np.float64),
        points,
        None if isinstance(matrix, Failed) else matrix,
        list(result.warnings),
        list(result.notes),
    )


def _check_pair(found: PairMatches) -> None:
    if not len(found.left) == len(found.right) == len(found.confidence):
        raise ValueError("a match has two polygons and a confidence")
    if not len(found.points.left) == len(found.points.right) == len(found.points.score):
        raise ValueError("a point has two places and a score")


def _check_carried(found: CarriedRegions) -> None:
    if len(found.status) != len(found.confidence):
        raise ValueError("a region has a status and a confidence")
    if not all(0 <= polygon.id < len(found.status) for polygon in found.outlines):
        raise ValueError("an outline is that of a region")


Work = TypeVar("Work", PairMatches, CarriedRegions)
_CONVERTER = Converter(
    {
        **LAYOUTS,
        PairMatches: Layout(shapes={"homography": (3, 3), "confidence": (-1,)}, check=_check_pair),
        CarriedRegions: Layout(shapes={"confidence": (-1,)}, check=_check_carried),
    }
)


class Store:
    """Finished work by key (`files.keys.key`), as files of a folder. Without a folder nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.reused = 0
        self._used = set[str]()

    def get(self, key: str, kind: type[Work], make: Callable[[], Work]) -> Work:
        """What an earlier run kept under the key, or else what `make` gives, which is then kept."""
        self._used.add(f"{key}.json.gz")
        if self.folder is None:
            return make()
        try:
            found = _CONVERTER.from_plain(kind, parse_json(unpack_gzip(self.folder / f"{key}.json.gz")))
            self.reused += 1
            return found
        except (OSError, InputError, *WRONG):  # none, or damaged
            made = make()
        data = gzip.compress(json.dumps(_CONVERTER.to_plain(made)).encode(), compresslevel=1, mtime=0)
        try:
            atomic_write(claim(self.folder, []) / f"{key}.json.gz", data)
        except OutputError as error:
            raise OutputError(f"{error}; finished pairs are kept, run the same command again to go on") from error
        return made

    @contextmanager
    def temporary(self) -> Iterator[Path | None]:
        """A folder beside the finished work, removed at the end; None without a folder. `OutputError`."""
        if self.folder is None:
            yield None
            return
        with ExitStack() as held:
            try:
                place = held.enter_context(temporary_folder(claim(self.folder, [])))
            except OSError as error:
                raise OutputError(f"cannot write into {self.folder}: {why(error, self.folder)}") from error
            yield place

    def forget_others(self) -> None:
        """Removes what this run did not use, so that the folder does not grow from run to run."""
        if self.folder is not None and self.folder.is_dir():
            for file in sorted(self.folder.glob("*.json.gz")):
                if file.name not in self._used:
                    with suppress(OutputError):  # not made by a run
                        remove_own(file)
