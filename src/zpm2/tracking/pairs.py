"""Which photographs are matched with each other."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from zpm2.config import Config, TracksConfig
from zpm2.errors import ConfigError, InputError
from zpm2.files.listing import text
from zpm2.formats.colmap import shared_points
from zpm2.formats.colmap_database import verified_pairs
from zpm2.runtime import Progress
from zpm2.tracking.look import agreeing_points
from zpm2.tracking.photographs import Photograph, distances

Pair = tuple[int, int]  # rows of the photographs, the smaller one first
WAYS = ("auto", "sequential", "exhaustive", "exif-gps", "colmap")
DATABASE = "database.db"


@dataclass(frozen=True)
class ChosenPairs:
    """The pairs, ascending, and how they were chosen."""

    pairs: list[Pair]
    how: str
    warnings: tuple[str, ...] = ()


def choose_pairs(
    photographs: Sequence[Photograph], way: str | Path, config: Config, device: str, progress: Progress
) -> ChosenPairs:
    """The pairs that `way` says: one of `WAYS`, a database or a model of COLMAP, or a list with two names a line.

    `ConfigError` for an unknown way, `InputError` for files that cannot be read, a name that is no photograph's, and
    where no pair is left.
    """
    own, n = config.tracks, len(photographs)
    if way == "sequential":
        found = [(i, j) for i in range(n) for j in range(i + 1, min(i + own.window, n - 1) + 1)]
        return _connected(photographs, found, f"sequential, {own.window} after each")
    if way == "exhaustive":
        return _connected(photographs, [(i, j) for i in range(n) for j in range(i + 1, n)], "exhaustive")
    if way in ("auto", "exif-gps"):
        apart = distances(photographs)
        if apart is not None:
            return _connected(photographs, _best(-apart, own), f"{way}, by position")
        if way == "exif-gps":
            raise InputError("--pairs exif-gps needs a position of every photograph, and not all the same: use auto")
        return _by_points(photographs, config, device, progress)
    file = _database(photographs[0].path) if way == "colmap" else Path(way)
    if way == "colmap" or file.suffix.lower() in (".db", ".sqlite"):
        pairs, unknown = _named([(a, b) for a, b, _ in verified_pairs(file)], photographs)
        return _connected(photographs, pairs, "COLMAP's verified matches", _more(file, unknown))
    if os.path.isdir(file):
        return _by_model(photographs, file, own)
    if not os.path.isfile(file):
        raise ConfigError(
            f"--pairs {way}: give one of {', '.join(WAYS)}, a list with two names a line, or a database or model of "
            "COLMAP"
        )
    pairs, unknown = _named(_listed(file), photographs)
    if unknown:
        raise InputError(f"{file} names {unknown[0]}, which is none of the photographs: correct the list")
    return _connected(photographs, pairs, f"as listed in {file.name}")


def _by_points(photographs: Sequence[Photograph], config: Config, device: str, progress: Progress) -> ChosenPairs:
    """Each photograph with those it shares most points with."""
    own, n = config.tracks, len(photographs)
    near = sorted(((i, j) for i in range(n) for j in range(i + 1, n)), key=lambda pair: (pair[1] - pair[0], pair))
    looked = near[: own.max_looks]
    warnings = []
    if len(looked) < len(near):
        warnings.append(
            f"of {len(near)} pairs only the {len(looked)} nearest by name were compared: raise tracks.max_looks, or "
            "choose other --pairs"
        )
    score = np.full((n, n), -np.inf)
    for (i, j), count in zip(looked, agreeing_points(photographs, looked, config, device, progress), strict=True):
        if count >= own.min_points:
            score[i, j] = score[j, i] = count
    return _connected(photographs, _best(score, own), "auto, by points", warnings)


def _by_model(photographs: Sequence[Photograph], folder: Path, config: TracksConfig) -> ChosenPairs:
    """Each photograph with those it shares most 3D points with."""
    names, shared = shared_points(folder)
    score, missing = np.full((len(photographs), len(photographs)), -np.inf), list[str]()
    rows = [_row(name, photographs) for name in names]
    for a, i in enumerate(rows):
        if i is None:
            missing.append(names[a])
            continue
        for b, j in enumerate(rows):
            if j is not None and shared[a, b] >= config.min_points:
                score[i, j] = shared[a, b]
    return _connected(photographs, _best(score, config), "3D points of COLMAP's model", _more(folder, missing))


def _more(place: Path, unknown: Sequence[str]) -> list[str]:
    """A warning about images of COLMAP that are none of the photographs."""
    return [f"{place} has {len(unknown)} more images than were given, {unknown[0]} for one"] if unknown else []


def _best(score: NDArray[np.float64], config: TracksConfig) -> list[Pair]:
    """Each photograph with the `neighbors` others of highest score (n, n); -inf is none."""
    pairs = set()
    for i, row in enumerate(score):
        others = [int(j) for j in np.argsort(-row, kind="stable") if j != i and np.isfinite(row[j])]
        pairs |= {(min(i, j), max(i, j)) for j in others[: config.neighbors]}
    return sorted(pairs)


def _connected(
    photographs: Sequence[Photograph], pairs: list[Pair], how: str, warnings: Sequence[str] = ()
) -> ChosenPairs:
    """The pairs, with a warning about photographs in none. `InputError` where there is no pair."""
    if not pairs:
        raise InputError(f"no pair of photographs to match ({how}): give photographs that overlap, or other --pairs")
    paired = {row for pair in pairs for row in pair}
    alone = [each.name for k, each in enumerate(photographs) if k not in paired]
    said = [*warnings, *(f"{name} is matched with no other photograph ({how})" for name in alone)]
    return ChosenPairs(sorted(set(pairs)), how, tuple(said))


def _named(names: Sequence[tuple[str, str]], photographs: Sequence[Photograph]) -> tuple[list[Pair], list[str]]:
    """The pairs of these names among the photographs, and the names that are none of theirs."""
    row_of: dict[str, int | None] = {}
    for both in names:
        for name in both:
            if name not in row_of:
                row_of[name] = _row(name, photographs)
    rows = [(row_of[a], row_of[b]) for a, b in names]
    pairs = [(min(i, j), max(i, j)) for i, j in rows if i is not None and j is not None and i != j]
    return pairs, [name for name, row in row_of.items() if row is None]


def _row(name: str, photographs: Sequence[Photograph]) -> int | None:
    """The photograph with that name; else the only one with that path from its end, or with that file name."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    names = [PurePosixPath(each.name).parts for each in photographs]
    if parts in names:
        return names.index(parts)
    for same in (len(parts), 1):
        rows = [k for k, each in enumerate(photographs) if Path(each.path).absolute().parts[-same:] == parts[-same:]]
        if len(rows) == 1:
            return rows[0]
    return None


def _listed(file: Path) -> list[tuple[str, str]]:
    """Two names a line, apart by a tab, a comma or spaces; lines that begin with # are comments."""
    found = []
    for number, line in enumerate(text(file).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        mark = "\t" if "\t" in line else "," if "," in line else None
        names = [name.strip() for name in line.strip().split(mark)]
        if len(names) != 2 or not all(names):
            raise InputError(f"{file}, line {number} has {len(names)} names: give two, apart by a space, comma or tab")
        found.append((names[0], names[1]))
    return found


def database_beside(photograph: str) -> Path | None:
    """The database of COLMAP beside a photograph, or one folder up; None where there is none."""
    folder = Path(photograph).absolute().parent
    return next((place for place in (folder / DATABASE, folder.parent / DATABASE) if place.is_file()), None)


def _database(photograph: str) -> Path:
    found = database_beside(photograph)
    if found is None:
        folder = Path(photograph).absolute().parent
        raise InputError(f"no {DATABASE} in {folder} or one folder up: give it as --pairs FILE.db")
    return found
