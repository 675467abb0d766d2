"""What the commands share: their options, the help and completion of these, and the configuration they make."""

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer
from typer.core import TyperCommand

from zpm2 import memory
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from typer._click import Context as Context  # older typers have none of their own and take that of click

    from zpm2.config import Config

# groups of options in the help
RESULT = "Results"
METHOD = "Method"
REGIONS = "Your own regions"
CAMERAS = "Cameras"
DATA = "Data set"
LARGE = "Large and georeferenced photographs"
RUN = "Run"


class HelpFormatter(Protocol):
    """What the help needs of click's formatter."""

    def section(self, name: str) -> AbstractContextManager[None]:
        """A titled part of the help."""

    def write_dl(self, rows: Sequence[tuple[str, str]]) -> None:
        """Options and what they mean, in two columns."""


class Command(TyperCommand):
    """A command that lists its options in groups, and whose memory budget ends with it."""

    def invoke(self, ctx: "Context") -> object:
        """As typer does."""
        with memory.within(memory.AUTO):
            return super().invoke(ctx)

    def format_options(self, ctx: "Context", formatter: HelpFormatter) -> None:
        """Arguments, then each group in the order of its first option."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for item in self.get_params(ctx):
            record = item.get_help_record(ctx)
            if record is not None:
                usual = "Arguments" if item.param_type_name == "argument" else "Options"
                groups.setdefault(getattr(item, "rich_help_panel", None) or usual, []).append(record)
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)


# Completion. What there is to choose from is looked up in the package's own registries, when the shell asks.


def one_of(values: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Completes one of some values; of a list, what follows its last comma."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + value for value in values() if value.startswith(last)]

    return complete


def choices(key: str) -> Callable[[], Iterable[str]]:
    """The values of a field of the configuration."""

    def values() -> Iterable[str]:
        from zpm2 import config

        return config.choices(key)

    return values


def presets() -> Iterable[str]:
    """The names of the presets."""
    from zpm2 import config

    return config.PRESETS


def methods() -> Iterable[str]:
    """The names of whole methods."""
    from zpm2.api import METHODS

    return METHODS


def segmenters() -> Iterable[str]:
    """The names of the segmenters."""
    from zpm2 import api

    return api.segmenters()


def registered_segmenters() -> Iterable[str]:
    """The names of the segmenters that a configuration may name."""
    from zpm2.segment.registry import SEGMENTERS

    return SEGMENTERS


def point_matchers() -> Iterable[str]:
    """The names of the point matchers."""
    from zpm2.features import METHODS

    return METHODS


def known_formats() -> Iterable[str]:
    """The names of the further output formats of a match."""
    from zpm2.formats import registry

    return registry.names()


def mask_programs() -> Iterable[str]:
    """The names of the programs that masks are written for."""
    from zpm2.formats import masks

    return masks.NAMES


def check_masks(programs: Sequence[str], regions: str | None, photographs: Sequence[Path]) -> bool:
    """Whether masks keep the regions. `ConfigError` for values that do not exist, and for photographs of one name."""
    from zpm2.formats import masks

    masks.check_names(programs, photographs)
    if regions not in ("keep", "remove", None):
        raise ConfigError(f"--mask-regions {regions}: give keep or remove")
    if regions is not None and not programs:
        raise ConfigError("--mask-regions needs --masks")
    return regions != "remove"


def check_formats(names: Iterable[str]) -> None:
    """`ConfigError` for a name that is not in `known_formats`, `MissingDependency` for a format without its library."""
    from zpm2.formats import registry

    registry.chosen(list(names))


def datasets() -> Iterable[str]:
    """The names of the data sets."""
    from zpm2.evaluate.datasets import DATASETS

    return DATASETS


def devices() -> Iterable[str]:
    """The names of the devices."""
    return ("auto", "cpu", "cuda")


def settings_of(incomplete: str) -> list[str]:
    """Completes stage.field=value."""
    from zpm2 import config

    key, equals, begun = incomplete.partition("=")
    fields = [name for name, *_ in config.describe(config.Config())]
    if not equals:
        return [f"{name}=" for name in fields if name.startswith(key)]
    registered = {"segment.model": registered_segmenters, "points.methods": point_matchers}
    values = registered.get(key) or (choices(key) if key in fields else tuple)
    return [f"{key}={value}" for value in one_of(values)(begun)]


# Checks of numbers that are no fields of the configuration.


def positive(what: str) -> Callable[[typer.CallbackParam, float | None], float | None]:
    """Refuses a number that is not finite and above 0."""

    def check(param: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not 0 < value < float("inf"):
            raise ConfigError(f"{param.opts[0]} {value}: give a {what} above 0")
        return value

    return check


Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.", rich_help_panel=RESULT)]
NonOverlapping = Annotated[
    bool,
    typer.Option("--non-overlapping", help="Assign every pixel to at most one match.", rich_help_panel=RESULT),
]
Preset = Annotated[
    str,
    typer.Option(
        help="default: finds more matches, in less time; paper: the published method and its numbers.",
        rich_help_panel=METHOD,
        autocompletion=one_of(presets),
    ),
]
Points = Annotated[
    str | None,
    typer.Option(
        help="One or several point matchers, for example xfeat,sift (docs/points.md); also package.module:Class.  "
        "[default: preset's]",
        rich_help_panel=METHOD,
        autocompletion=one_of(point_matchers),
    ),
]
Method = Annotated[
    str,
    typer.Option(
        help="zpm2, or another one on the same regions: shape-context, idsc, vote, masa, sgam, mesa.",
        rich_help_panel=METHOD,
        autocompletion=one_of(methods),
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config", help="A .toml or .json file whose fields replace those of the preset.", rich_help_panel=METHOD
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.FIELD=VALUE",
        help="Set one field of the configuration (zpm2 config list shows them). Repeatable.",
        rich_help_panel=METHOD,
        autocompletion=settings_of,
    ),
]
Bands = Annotated[
    str | None,
    typer.Option(
        help="Bands to read, counted from 1: one, or red,green,blue.  [default: as the file says]",
        rich_help_panel=LARGE,
    ),
]
AllowVrt = Annotated[
    list[Path] | None,
    typer.Option(
        "--allow-vrt",
        metavar="FOLDER",
        help="VRT files may read only files beside themselves; allow this folder, too. Repeatable.",
        rich_help_panel=LARGE,
    ),
]
Device = Annotated[
    str | None,
    typer.Option(
        help="Where to compute: auto, cpu or cuda.  [default: auto]",
        rich_help_panel=RUN,
        autocompletion=one_of(devices),
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(
        help="Seed of the random numbers; the same seed gives the same bytes.  [default: 0]", rich_help_panel=RUN
    ),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Most memory to use, for example 8GB or 512MB. A pair that needs more is matched in tiles, or refused.  "
        "[default: 80% of what is free]",
        rich_help_panel=RUN,
    ),
]
WeightsDir = Annotated[
    Path | None,
    typer.Option(help="Folder with your own copies of the weights, searched first.", rich_help_panel=RUN),
]
Masks = Annotated[
    list[str] | None,
    typer.Option(
        "--masks",
        metavar="PROGRAM",
        help="Also write masks of the photographs for colmap, openmvs or nerfstudio. Repeatable.",
        rich_help_panel=RESULT,
        autocompletion=one_of(mask_programs),
    ),
]
MaskRegions = Annotated[
    str | None,
    typer.Option(
        help="What the masks say of the regions: keep (all else is ignored) or remove (the regions are ignored).  "
        "[default: keep]",
        rich_help_panel=RESULT,
        autocompletion=one_of(lambda: ("keep", "remove")),
    ),
]
Report = Annotated[
    bool,
    typer.Option(
        "--report/--no-report",
        help="Write report.html, a page to look at the result (zpm2 view).",
        rich_help_panel=RESULT,
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.", rich_help_panel=RUN)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.", rich_help_panel=RUN)]


def configure(preset: str, file: Path | None = None, settings: list[str] | None = None, **options: object) -> "Config":
    """The preset, under the file, under the settings, under those `options` (`config.OPTIONS`) that are not None. Its
    memory budget holds for the rest of the command."""
    from zpm2 import config

    chosen = config.preset(preset)
    if file is not None:
        chosen = config.load(file, chosen)
    chosen = config.with_options(config.assign(chosen, settings or []), options)
    memory.limit(chosen.max_memory)
    return chosen


def use_weights(directory: Path | None) -> None:
    """Look for weights in a folder of the user's first."""
    if directory is not None:
        if not directory.is_dir():
            raise ConfigError(f"--weights-dir {directory} is not a folder: give one that holds weight files")
        os.environ["ZPM2_WEIGHTS"] = str(directory)


def allow_vrt(folders: list[Path] | None) -> None:
    """Let VRT files have sources below some folders of the user's."""
    from zpm2.photos import vrt

    vrt.allow(folders or [])
