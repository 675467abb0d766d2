"""What is done with each pair or group of a list: settings that travel to the processes that do it."""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from zpm2.batch.entries import Entry, Kind, Pair, TileEntry
from zpm2.config import Config, preset
from zpm2.errors import ConfigError, did_you_mean
from zpm2.files.keys import code_of, key, stamp
from zpm2.formats.regions.region import split_layer
from zpm2.pipeline import matching_part, plugin_code
from zpm2.plugins import module_of, value_at
from zpm2.tracking.pairs import WAYS, database_beside

COMMANDS = ("match", "pose", "carry", "tracks")
TILES = "zpm2.batch.tiles:Tiles"  # the command for tiles of a large pair
MACHINE = ("device", "max_memory")  # parts of the configuration that change no result


@dataclass(frozen=True)
class Job:
    """The command and its settings."""

    out: str  # folder, or an address that fsspec knows
    command: str = "match"  # one of `COMMANDS`, or package.module:Class (`commands.PairCommand`)
    config: Config = field(default_factory=lambda: preset("default"))
    formats: tuple[str, ...] = ()  # of `match`, as `MatchResult.save` takes them
    report: bool = False  # whether each result gets its report.html
    pictures: bool = False  # overlay.png and unmatched.png of `match` and `pose`, contact sheets of `tracks`
    regions: str | None = None  # of `carry`, for pairs whose list names none
    rigid: bool = False  # of `carry`
    k: str | None = None  # of `pose`, for pairs whose list names none
    k2: str | None = None
    centers: float = 0.5  # px
    way: str = "auto"  # of `tracks`, which photographs of a group are matched (`tracking.pairs.WAYS`)
    at_once: int = 2  # pairs in work in each process, see `Matcher.match_many`
    photographs: int = 8  # that each process keeps

    def check(self) -> None:
        """`ConfigError` for a command that does not exist, or one of its settings."""
        if self.command == "tracks" and self.way not in WAYS:
            raise ConfigError(f"--pairs {self.way}: for the groups of a list, give one of {', '.join(WAYS)}")
        if ":" not in self.command and self.command not in COMMANDS:
            raise ConfigError(
                f"unknown command '{self.command}'{did_you_mean(self.command, COMMANDS)}; commands are: "
                f"{', '.join(COMMANDS)}"
            )
        for option, value, commands in (
            ("--format", self.formats, ("match", "pose")),
            ("--pictures", self.pictures, ("match", "pose", "tracks")),
            ("--regions", self.regions, ("carry",)),
            ("--rigid", self.rigid, ("carry",)),
            ("--K", self.k, ("pose",)),
            ("--K2", self.k2, ("pose",)),
        ):
            if value and self.command in COMMANDS and self.command not in commands:
                raise ConfigError(f"{option} is for --command {' or '.join(commands)}: leave it out")

    @property
    def kind(self) -> Kind:
        """What it is done with."""
        kinds: dict[str, Kind] = {"tracks": "group", TILES: "tile"}
        return kinds.get(self.command, "pair")

    def made_with(self) -> str:
        """The key of all that the pairs have in common."""
        everything = {name: value for name, value in self.config.to_dict().items() if name not in MACHINE}
        settings = matching_part(self.config) if self.command == "match" else everything
        foreign = code_of(module_of(value_at(self.command, "command"))) if ":" in self.command else ""
        plain = self.command, self.formats, self.report, self.pictures, self.rigid, self.centers
        way = [self.way] if self.command == "tracks" else []
        return key((), settings, *plugin_code(self.config), foreign, *plain, *way)

    def filled(self, pair: Pair) -> Pair:
        """The pair with what the job gives to those that lack it. `ConfigError` where regions are to be carried and
        there are none."""
        regions = pair.regions or self.regions
        if self.command == "carry" and regions is None:
            raise ConfigError("--command carry needs --regions, or a column regions in the list of pairs")
        cameras = (pair.k, pair.k2) if pair.k is not None else (self.k, self.k2)
        return replace(pair, regions=regions, k=cameras[0], k2=cameras[1])


class Task(NamedTuple):
    """A pair, a group or a tile to be done."""

    entry: Entry | TileEntry
    key: str  # of what its result is made from


def tasks(job: Job, entries: Iterable[Entry]) -> list[Task]:
    """The pairs or groups with the keys of their results: of the photographs, regions and cameras, and of all that
    `job` says. A photograph is read once, however many pairs it is in."""
    base, known = job.made_with(), functools.cache(stamp)
    found = []
    for entry in entries:
        files: Sequence[str | Path | None]
        more: Sequence[str | None] = ()
        if isinstance(entry, Pair):
            entry = job.filled(entry)
            regions, layer = (None, None) if entry.regions is None else split_layer(entry.regions)
            files, more = (entry.left, entry.right, regions, entry.k, entry.k2), (layer, entry.k, entry.k2)
        else:
            files = (*entry.photographs, database_beside(entry.photographs[0]) if job.way == "colmap" else None)
        stamps = [known(str(file)) for file in files if file is not None]
        found.append(Task(entry, key((), base, stamps, *more)))
    return found
