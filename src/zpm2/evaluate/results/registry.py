"""Formats of other tools' area matches, by name (`zpm2.plugins`): the files of this folder, and of other packages.

A reader registers itself where it is defined:

    @result_format("mine", where="FOLDER/NAME.txt")
    def read(folder: Path, pair: SizedPair) -> AreaMatches | None: ...
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from zpm2.errors import ConfigError
from zpm2.evaluate.results.areas import AreaMatches, SizedPair
from zpm2.plugins import Registry, module_of

Read = Callable[[Path, SizedPair], AreaMatches | None]  # None where the folder has nothing of the pair


@dataclass(frozen=True)
class ResultFormat:
    """A registered format."""

    name: str
    read: Read  # raises `InputError` for a file that cannot be used
    where: str  # what a folder holds for the pair NAME, for messages


def _adopted(name: str, value: object) -> ResultFormat:
    if not callable(value):
        raise ConfigError(f"result format '{name}' is a {type(value).__name__}: give a function of a folder and a pair")
    return ResultFormat(name, value, "something")


RESULTS: Registry[ResultFormat] = Registry(
    "result format", "result formats", "zpm2.results", "zpm2.evaluate.results", _adopted
)


def result_format(name: str, *, where: str) -> Callable[[Read], Read]:
    """Register the reader of the format `name`, see `ResultFormat`. `ValueError` for a taken name."""

    def register(read: Read) -> Read:
        RESULTS.register(name, ResultFormat(name, read, where), read, module_of(read))
        return read

    return register
