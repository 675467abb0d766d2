"""The file formats of a result, by name: the one list that `MatchResult.save`, `--format` and its completion read.

Each module in `formats/writers/` registers its format, so a new one is one new file there. A format of your own may
live anywhere (`zpm2.plugins`): call `register` before you save, or offer it to all who install your package.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import ConfigError, Failed
from zpm2.model import ImagePolygons, PointMatches, PolygonMatch
from zpm2.plugins import Registry, module_of


class PairResult(Protocol):
    """What a format may write of a `zpm2.MatchResult`."""

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
    def config(self) -> Mapping[str, Any]: ...

    def to_dict(self) -> dict[str, Any]:
        """The content of `matches.json`."""
        ...


@dataclass(frozen=True)
class OutputFormat:
    """A file format that a result can be saved in."""

    name: str  # for `--format`
    files: tuple[str, ...]  # all names that it may write in the output folder
    write: Callable[[PairResult, Path], object]  # writes into an existing folder; `OutputError`
    check: Callable[[], object] = lambda: None  # raises `MissingDependency` where a package that it needs is missing
    # whether a result is saved in it without being asked to; None: never
    by_default: Callable[[PairResult], bool] | None = None


def _adopted(name: str, value: Any) -> OutputFormat:
    if not isinstance(value, OutputFormat):
        raise ConfigError(f"format '{name}' is a {type(value).__name__}: give an OutputFormat (zpm2.formats.registry)")
    return value


FORMATS: Registry[OutputFormat] = Registry("format", "formats", "zpm2.formats", "zpm2.formats.writers", _adopted)


def register(output_format: OutputFormat) -> OutputFormat:
    """Adds a format. `ValueError` for a taken name."""
    FORMATS.register(output_format.name, output_format, output_format, module_of(output_format.write))
    return output_format


def known() -> list[OutputFormat]:
    """All formats that can be used."""
    return FORMATS.values()


def names() -> list[str]:
    """The names of all formats."""
    return FORMATS.names()


def chosen(names: Sequence[str]) -> list[OutputFormat]:
    """The formats of these names, each once, with their packages there. `ConfigError` for an unknown name,
    `MissingDependency`."""
    found = [FORMATS.get(name) for name in dict.fromkeys(names)]
    for each in found:
        each.check()
    return found
