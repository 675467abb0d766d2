"""What is done with each pair of a list: settings that travel to the processes that do it."""

import functools
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from zpm2.batch.pair_list import Pair
from zpm2.config import Config, preset
from zpm2.errors import ConfigError, did_you_mean
from zpm2.files.keys import code_of, key, stamp
from zpm2.formats.regions.region import split_layer
from zpm2.pipeline import matching_part, plugin_code
from zpm2.plugins import module_of, value_at

COMMANDS = ("match", "pose", "carry")
MACHINE = ("device", "max_memory")  # parts of the configuration that change no result


@dataclass(frozen=True)
class Job:
    """The command and its settings."""

    out: str  # folder, or an address that fsspec knows
    command: str = "match"  # one of `COMMANDS`, or package.module:Class (`commands.PairCommand`)
    config: Config = field(default_factory=lambda: preset("default"))
    formats: tuple[str, ...] = ()  # of `match`, as `MatchResult.save` takes them
    report: bool = False  # whether each result gets its report.html
    pictures: bool = False  # whether `match` and `pose` write overlay.png and unmatched.png
    regions: str | None = None  # of `carry`, for pairs whose list names none
    rigid: bool = False  # of `carry`
    k: str | None = None  # of `pose`, for pairs whose list names none
    k2: str | None = None
    centers: float = 0.5  # px
    at_once: int = 2  # pairs in work in each process, see `Matcher.match_many`
    photographs: int = 8  # that each process keeps

    def check(self) -> None:
        """`ConfigError` for a command that does not exist."""
        if self.command == "tracks":
            raise ConfigError(
                "--command tracks: tracks belong to many photographs, not to a pair: zpm2 tracks matches its pairs and "
                "goes on after an interruption, too"
            )
        if ":" not in self.command and self.command not in COMMANDS:
            raise ConfigError(
                f"unknown command '{self.command}'{did_you_mean(self.command, COMMANDS)}; commands are: "
                f"{', '.join(COMMANDS)}"
            )

    def made_with(self) -> str:
        """The key of all that the pairs have in common."""
        everything = {name: value for name, value in self.config.to_dict().items() if name not in MACHINE}
        settings = matching_part(self.config) if self.command == "match" else everything
        foreign = code_of(module_of(value_at(self.command, "command"))) if ":" in self.command else ""
        plain = self.command, self.formats, self.report, self.pictures, self.rigid, self.centers
        return key((), settings, *plugin_code(self.config), foreign, *plain)

    def filled(self, pair: Pair) -> Pair:
        """The pair with what the job gives to those that lack it. `ConfigError` where regions are to be carried and
        there are none."""
        regions = pair.regions or self.regions
        if self.command == "carry" and regions is None:
            raise ConfigError("--command carry needs --regions, or a column regions in the list of pairs")
        cameras = (pair.k, pair.k2) if pair.k is not None else (self.k, self.k2)
        return replace(pair, regions=regions, k=cameras[0], k2=cameras[1])


class Task(NamedTuple):
    """A pair to be done."""

    pair: Pair
    key: str  # of what its result is made from


def tasks(job: Job, pairs: Iterable[Pair]) -> list[Task]:
    """The pairs with the keys of their results: of the photographs, regions and cameras, and of all that `job` says. A
    photograph is read once, however many pairs it is in."""
    base, known = job.made_with(), functools.cache(stamp)
    found = []
    for pair in map(job.filled, pairs):
        regions, layer = (None, None) if pair.regions is None else split_layer(pair.regions)
        files = [known(str(file)) for file in (pair.left, pair.right, regions, pair.k, pair.k2) if file is not None]
        found.append(Task(pair, key((), base, files, layer, pair.k, pair.k2)))
    return found
