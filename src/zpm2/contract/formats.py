"""The contract of an output format (`zpm2.formats.registry`)."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from zpm2.contract.check import expect
from zpm2.errors import Failed
from zpm2.formats.registry import OutputFormat
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult


def example() -> MatchResult:
    """A result with polygons with a hole and a parent, matches, and an estimate that failed."""
    hole = np.array([[15.0, 15], [15, 18.25], [18, 18]])
    lefts = [_square(3, 10, (hole,)), _square(5, 50, label="roof")]
    rights = [_square(0, 8), _square(1, 48)]
    matches = [PolygonMatch(3, 0, 0.75, 0.125, 12, "global", 0.5), PolygonMatch(5, 1, 0.3, 2.5, 0, "local")]
    points = PointMatches(np.array([[1.5, 2.0]]), np.array([[0.5, 2.0]]), np.array([1.0]))
    return _result(lefts, rights, matches, points)


def nothing() -> MatchResult:
    """A result without regions."""
    return _result([], [], [], PointMatches.empty())


def names_its_files(made: OutputFormat) -> None:
    """It has a name, and lists the names of all files that it may write."""
    expect(isinstance(made.name, str) and bool(made.name.strip()), "it has no name: give it one word")
    good = isinstance(made.files, tuple) and bool(made.files) and all(isinstance(name, str) for name in made.files)
    expect(good, "files is no tuple of names: list all that it may write")
    expect(
        all(name == Path(name).name for name in made.files), "files holds paths: names only, it writes into one folder"
    )


def writes_what_it_says(made: OutputFormat) -> None:
    """It writes at least one file, none but those that it lists, and leaves others alone."""
    for result in (example(), nothing()):
        with tempfile.TemporaryDirectory() as folder:
            other = Path(folder) / "notes.txt"
            other.write_text("mine")
            made.write(result, Path(folder))
            written = {path.name for path in Path(folder).iterdir()} - {other.name}
            more = sorted(written - set(made.files))
            expect(not more, f"it writes {', '.join(more)}, which its files do not name: list them")
            expect(bool(written), "it writes nothing: a result without matches is a file, too")
            expect(other.is_file() and other.read_text() == "mine", "it changes a file that is not its own")


def same_bytes_twice(made: OutputFormat) -> None:
    """The same result gives the same bytes, and is not changed by being written."""
    result = example()
    before = repr(result.to_dict())
    found = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            made.write(result, Path(folder))
            found.append({path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())})
    changed = sorted(name for name in found[0] if found[0][name] != found[1].get(name))
    expect(not changed, f"{', '.join(changed)} has other bytes the second time: write no time, and sort sets")
    expect(repr(result.to_dict()) == before, "it changes the result that it writes")


def answers(made: OutputFormat) -> None:
    """`check` returns, or raises `MissingDependency`; `by_default` says True or False."""
    made.check()
    if made.by_default is not None:
        expect(isinstance(made.by_default(example()), bool), "by_default returns no bool")


def _square(id: int, x: float, holes: tuple[np.ndarray, ...] = (), label: str | None = None) -> Polygon:
    return Polygon(id, np.array([[x, 10], [x + 20, 10], [x + 20, 30], [x, 30.0]]), holes, 0.9, label=label)


def _result(
    lefts: list[Polygon], rights: list[Polygon], matches: list[PolygonMatch], points: PointMatches
) -> MatchResult:
    return MatchResult(
        left=ImagePolygons(100, 60, lefts),
        right=ImagePolygons(90, 70, rights),
        matches=matches,
        points=points,
        fundamental=np.array([[0, -1e-7, 0.1], [1 / 3, 0, 2], [3, 4, 5]]),
        homography=Failed("only 1 homologous point"),
        config={},
        timings={},
    )


CHECKS: Mapping[str, Callable[[OutputFormat], None]] = {
    "names its files": names_its_files,
    "writes what it says": writes_what_it_says,
    "gives the same bytes twice": same_bytes_twice,
    "answers what it is asked": answers,
}
