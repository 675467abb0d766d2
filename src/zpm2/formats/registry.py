"""The output formats of a result, by name, for `MatchResult.save`, `--format` and its completion.

Each module in `formats/writers/` registers its format, so a new format is one new file there. Your own format may be
anywhere: call `register` before you save.
"""

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import ConfigError, Failed
from zpm2.formats.convert import Members
from zpm2.model import ImagePolygons, PointMatches, PolygonMatch


class PairResult(Protocol):
    """The part of a `zpm2.MatchResult` that a format may use."""

    @property
    def left(self) -> ImagePolygons: ...

    @property
    def right(self) -> ImagePolygons: ...

    @property
    def matches(self) -> Sequence[PolygonMatch]: ...

    @property
    def points(self) -> PointMatches: ...

    @property
    def fundamental(self) -> NDArray[np.float64] | Failed: ...

    @property
    def homography(self) -> NDArray[np.float64] | Failed: ...

    @property
    def config(self) -> Mapping[str, object]: ...

    def to_dict(self) -> Members:
        """The content of `matches.json`."""
        ...


@dataclass(frozen=True)
class OutputFormat:
    """A file format that a result can be saved in."""

    name: str  # for `--format`
    files: tuple[str, ...]  # all names that it may write in the output folder
    write: Callable[[PairResult, Path], object]  # writes into an existing folder; `OutputError`
    check: Callable[[], object] = lambda: None  # raises `MissingDependency` where a package that it needs is missing
    # whether a result is saved in it by default; None: never
    by_default: Callable[[PairResult], bool] | None = None


_FORMATS: dict[str, OutputFormat] = {}


def register(output_format: OutputFormat) -> OutputFormat:
    """Adds a format; replaces one of the same name."""
    _FORMATS[output_format.name] = output_format
    return output_format


def known() -> list[OutputFormat]:
    """All formats, by name."""
    _import_writers()
    return [_FORMATS[name] for name in sorted(_FORMATS)]


def names() -> list[str]:
    """The names of all formats, sorted."""
    return [each.name for each in known()]


def chosen(names: Sequence[str]) -> list[OutputFormat]:
    """The formats of these names. `ConfigError` for an unknown name, `MissingDependency` for a missing package."""
    by_name = {each.name: each for each in known()}
    for name in names:
        if name not in by_name:
            raise ConfigError(f"unknown format '{name}'; formats are: {', '.join(by_name)}")
        by_name[name].check()
    return [by_name[name] for name in by_name if name in names]


@cache
def _import_writers() -> None:
    from zpm2.formats import writers

    for module in pkgutil.iter_modules(writers.__path__):
        importlib.import_module(f"{writers.__name__}.{module.name}")
