"""What the commands share: their options and help, the configuration that these make, progress, interrupts, weights."""

import dataclasses
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from zpm2 import memory
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.model import Image
    from zpm2.result import MatchResult

# groups of options in the help
RESULT = "Results"
METHOD = "Method"
REGIONS = "Your own regions"
CAMERAS = "Cameras"
LARGE = "Large and georeferenced photographs"
RUN = "Run"

EVERY = 30.0  # seconds between the lines about a run where no bar can be shown


class Command(TyperCommand):
    """A command whose help has the options in their groups, and whose budget of memory ends with it."""

    def invoke(self, ctx: Any) -> Any:
        """As typer does."""
        with memory.within(memory.AUTO):
            return super().invoke(ctx)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then each group in the order of its first option."""
        groups: dict[str, list[Any]] = {}
        for item in self.get_params(ctx):
            record = item.get_help_record(ctx)
            if record is not None:
                usual = "Arguments" if item.param_type_name == "argument" else "Options"
                groups.setdefault(getattr(item, "rich_help_panel", None) or usual, []).append(record)
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)


def one_of(values: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Completes one of some values, in a list after its last comma. They are looked up when the shell asks."""

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


def settings_of(incomplete: str) -> list[str]:
    """Completes stage.field=value."""
    from zpm2 import config

    key, equals, _ = incomplete.partition("=")
    found = [name for name, *_ in config.describe(config.Config()) if name.startswith(key)]
    if not equals:
        return [f"{name}=" for name in found]
    return [text for text in (f"{key}={value}" for value in config.choices(key)) if text.startswith(incomplete)]


def known_formats() -> Iterable[str]:
    """The file formats that can be asked for."""
    from zpm2.formats import registry

    return registry.names()


def point_methods() -> Iterable[str]:
    """The names of the point matchers."""
    from zpm2.features import METHODS

    return METHODS


def methods() -> Iterable[str]:
    """The names of whole methods."""
    from zpm2.api import METHODS

    return METHODS


Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.", rich_help_panel=RESULT)]
Preset = Annotated[
    str,
    typer.Option(
        help="paper: the published method and numbers. default: the best we know.",
        rich_help_panel=METHOD,
        autocompletion=one_of(presets),
    ),
]
Method = Annotated[
    str,
    typer.Option(
        help="zpm2, or a classical baseline: shape-context, idsc.",
        rich_help_panel=METHOD,
        autocompletion=one_of(methods),
    ),
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="A .toml or .json file, laid over the preset.", rich_help_panel=METHOD)
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.FIELD=VALUE",
        help="Any field, see zpm2 config list. Repeatable.",
        rich_help_panel=METHOD,
        autocompletion=settings_of,
    ),
]
Bands = Annotated[
    str | None,
    typer.Option(
        help="One band or three (red,green,blue), from 1 on.  [default: as the file says]", rich_help_panel=LARGE
    ),
]
AllowVrt = Annotated[
    list[Path] | None,
    typer.Option(
        "--allow-vrt",
        metavar="FOLDER",
        help="Read VRT files with sources below this folder, not only beside them. Repeatable.",
        rich_help_panel=LARGE,
    ),
]
Device = Annotated[
    str | None,
    typer.Option(
        help="auto, cpu or cuda.  [default: auto]",
        rich_help_panel=RUN,
        autocompletion=one_of(lambda: ("auto", "cpu", "cuda")),
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(help="Of everything random; the same seed gives the same bytes.  [default: 0]", rich_help_panel=RUN),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="At most this much memory (8GB, 512MB): by tiles, or not at all, what needs more.  [default: 80% of what "
        "is free]",
        rich_help_panel=RUN,
    ),
]
WeightsDir = Annotated[
    Path | None, typer.Option(help="A folder with your own copies of the weights.", rich_help_panel=RUN)
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.", rich_help_panel=RUN)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.", rich_help_panel=RUN)]


def configure(preset: str, file: Path | None, settings: list[str] | None, options: dict[str, Any]) -> "Config":
    """The preset, under the file, under the settings, under those `options` (`config.OPTIONS`) that were given. Its
    budget of memory holds for the command from here on."""
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
            raise ConfigError(f"--weights-dir {directory} is no folder: give one that holds weight files")
        os.environ["ZPM2_WEIGHTS"] = str(directory)


def allow_vrt(folders: list[Path] | None) -> None:
    """Let VRT files have sources below some folders of the user's."""
    from zpm2.photos import vrt

    vrt.allow(folders or [])


def given_matches(folder: Path, photographs: Sequence[Path], images: "Sequence[Image]") -> "MatchResult":
    """The matches of `--matches FOLDER`, of these photographs.

    `ConfigError` where they are of another size or given the wrong way round. Another file of the same size may be the
    same photograph, better exposed for instance: a warning of the result says so.
    """
    from zpm2.files.listing import json_file
    from zpm2.files.photo_paths import are_swapped, has_content
    from zpm2.model import SIDES
    from zpm2.result import MatchResult

    matched = MatchResult.load(folder)
    document = json_file(folder / "matches.json" if os.path.isdir(folder) else folder)
    noted = [document[name] for name in SIDES]
    if are_swapped(noted, photographs):
        raise ConfigError(f"--matches {folder} is of these images the other way round: exchange them")
    warnings = list(matched.warnings)
    for k, (name, side) in enumerate(zip(SIDES, (matched.left, matched.right), strict=True)):
        image, path = images[k], photographs[k]
        if (side.width, side.height) != (image.width, image.height):
            raise ConfigError(
                f"--matches {folder} is of a {name} image of {side.width} x {side.height} px, this one has "
                f"{image.width} x {image.height} px: give the images that were matched"
            )
        if not has_content(noted[k], path):
            warnings.append(
                f"{path} is not the file that {folder} has matches of, only of the same size: where it shows anything "
                "else, the result is wrong"
            )
    return dataclasses.replace(matched, warnings=warnings)


@contextmanager
def bars(silent: bool) -> Iterator[tuple[Callable[[str, float], None], Callable[[str], None]]]:
    """A bar per stage on stderr, or a line now and then where that is no terminal, and a voice for single lines; both
    mute when `silent`."""
    if silent:
        yield lambda stage, share: None, lambda text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        with lines() as tell:
            yield tell, console.print
        return
    columns = TextColumn("{task.description:<8}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as shown:
        tasks: dict[str, Any] = {}

        def progress(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=1.0)
            shown.update(tasks[stage], completed=share)

        yield progress, console.print


@contextmanager
def lines() -> Iterator[Callable[[str, float], None]]:
    """How far a long run is, a line on stderr every `EVERY` seconds; the function takes a stage and its share."""
    start, now, over = monotonic(), ["start", 0.0], threading.Event()

    def tell() -> None:
        while not over.wait(EVERY):
            print(f"{now[0]}: {now[1]:.0%}, {monotonic() - start:.0f} s", file=sys.stderr, flush=True)

    def progress(stage: str, share: float) -> None:
        now[:] = [stage, share]

    voice = threading.Thread(target=tell, daemon=True)
    voice.start()
    try:
        yield progress
    finally:
        over.set()
        voice.join()


@contextmanager
def fresh_folder(out: Path, *inputs: Path | None, names: Iterable[str] = (), kept: str = "") -> Iterator[Path]:
    """The output folder, tried out, in which only what a run made is replaced (`files.writing.results_folder`);
    gone again if a run that made it ends early and left nothing in it. An interrupt says what stays.

    names: of the files and folders that the command may write there. kept: the place in it of what an interrupted run
    leaves for the next one.
    """
    from zpm2.files.record import HIDDEN
    from zpm2.files.writing import results_folder

    try:
        with results_folder(out, names, [path for path in inputs if path is not None]):
            yield out
    except KeyboardInterrupt as stop:
        if kept and any((out / kept).glob("*")):
            stop.add_note(f"what is finished is kept in {out / kept}: run the same command again to go on")
        else:
            stop.add_note(f"what was finished stays in {out}" if (out / HIDDEN).exists() else "nothing was written")
        raise


class Interrupted(Exception):
    """A run that was interrupted; the text says what stays, by the notes of who knows."""

    def __init__(self, stop: KeyboardInterrupt) -> None:
        super().__init__("; ".join(["interrupted", *dict.fromkeys(getattr(stop, "__notes__", []))]))


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM ends what runs inside as Ctrl-C does, so that it cleans up and says what stays."""

    def stop(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
