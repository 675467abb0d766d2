"""The homologous points of many pairs as keypoints of photographs and matches between them."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.local_match.shared_points import shared_points
from zpm2.model import PointMatches, PolygonArrays
from zpm2.result import MatchResult

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PairPoints:
    """The matches of two photographs."""

    names: tuple[str, str]
    rows: Rows  # (m, 2) the keypoint of the first and of the second photograph
    score: Array  # (m,) 0..1, the point matcher's


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Photographs with their keypoints, and pairs with their matches, both in the order of their names."""

    root: Path  # the folder that the names start from
    points: Mapping[str, Array]  # name, with / -> (n, 2) image px, pixel centres at +0.5, each point once
    pairs: Sequence[PairPoints]


def collect(results: Iterable[MatchResult], root: Path | None = None, matched: bool = False) -> Keypoints:
    """The points of all results. A point that several pairs have is one keypoint, to the float32.

    root: the folder that names of photographs start from; None: the deepest that holds all. matched: only points inside
    both polygons of a match. A pair that several results have gets the points of all of them. `InputError` where a
    result has no file of a photograph, one lies outside of `root`, or a name has a space, which lists of pairs cannot
    hold.
    """
    found = [(_files(result), _points(result, matched)) for result in results]
    if not found:
        raise InputError("no results to export: give folders that zpm2 match or zpm2 eval wrote")
    files = sorted({file for pair, _ in found for file in pair})
    root = Path(os.path.commonpath([file.parent for file in files])) if root is None else Path(os.path.abspath(root))
    name_of = {file: _name(file, root) for file in files}
    points: dict[str, list[NDArray[np.float32]]] = {name: [] for name in name_of.values()}
    parts: dict[tuple[str, str], list[tuple[int, int, Array]]] = {}  # which of a photograph's arrays, and the scores
    for pair, matches in found:
        first, second = (name_of[file] for file in pair)
        sides = matches.left, matches.right
        if first > second:
            first, second, sides = second, first, sides[::-1]
        for name, side in zip((first, second), sides, strict=True):
            points[name].append(side.astype(np.float32))
        part = len(points[first]) - 1, len(points[second]) - 1, matches.score
        parts.setdefault((first, second), []).append(part)
    joined = {name: _joined(each) for name, each in points.items()}
    rows = {name: each[1] for name, each in joined.items()}
    pairs = [_pair(names, rows[names[0]], rows[names[1]], parts[names]) for names in sorted(parts)]
    return Keypoints(root, {name: each[0] for name, each in sorted(joined.items())}, pairs)


def _joined(parts: Sequence[NDArray[np.float32]]) -> tuple[Array, list[Rows]]:
    """All points of a photograph, each once, and for each part the rows of its points."""
    points, rows = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
    ends = np.cumsum([len(part) for part in parts])
    return points.astype(np.float64), np.split(rows.ravel().astype(np.int64), ends[:-1])


def _pair(
    names: tuple[str, str], left: Sequence[Rows], right: Sequence[Rows], parts: Sequence[tuple[int, int, Array]]
) -> PairPoints:
    """Each match once, with its best score; in the order of rows."""
    rows = np.concatenate([np.stack([left[i], right[j]], 1) for i, j, _ in parts])
    score = np.concatenate([score for _, _, score in parts])
    order = np.lexsort((-score, rows[:, 1], rows[:, 0]))
    rows, score = rows[order], score[order]
    new = np.ones(len(rows), bool)
    new[1:] = (rows[1:] != rows[:-1]).any(1)
    return PairPoints(names, rows[new], score[new])


def _points(result: MatchResult, matched: bool) -> PointMatches:
    if not matched:
        return result.points
    sides = (PolygonArrays(polygons) for polygons in result.matched_polygons())
    shared = shared_points(result.points, *sides)
    own = np.flatnonzero(shared.pairs.left == shared.pairs.right)  # both polygons of one match
    rows = [shared.point[shared.start[k] : shared.start[k + 1]] for k in own]
    return result.points[np.unique(np.concatenate([np.zeros(0, np.int64), *rows]))]


def _files(result: MatchResult) -> tuple[Path, Path]:
    sides = [side.path for side in (result.left, result.right)]
    if any(path is None or not os.path.isfile(path) for path in sides):
        raise InputError(
            f"the photographs of a result, {sides[0]} and {sides[1]}, are no longer there: put them back or move them "
            "with the result"
        )
    left, right = (Path(os.path.abspath(path)) for path in sides if path is not None)
    if left == right:
        raise InputError(f"a result has {left} on both sides: export pairs of different photographs")
    return left, right


def _name(file: Path, root: Path) -> str:
    if not file.is_relative_to(root):
        raise InputError(f"{file} does not lie in {root}: give --images a folder that holds all photographs")
    name = file.relative_to(root).as_posix()
    if len(name.split()) != 1:
        raise InputError(f"'{name}' has a space in its name, which lists of pairs cannot hold: rename it")
    return name
