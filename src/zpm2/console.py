"""What the commands share: their common options, the configuration that these make, progress bars, weights."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2.errors import ConfigError, Zpm2Error

if TYPE_CHECKING:
    from zpm2.config import Config

Preset = Annotated[str, typer.Option(help="paper: the published method and numbers. default: the best we know.")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="A .toml or .json file, laid over the preset.")]
Settings = Annotated[list[str] | None, typer.Option("--set", metavar="STAGE.FIELD=VALUE", help="Repeatable.")]
Bands = Annotated[
    str | None, typer.Option(help="One band or three (red,green,blue), from 1 on.  [default: as the file says]")
]
Device = Annotated[str | None, typer.Option(help="auto, cpu or cuda.  [default: auto]")]
Seed = Annotated[
    int | None, typer.Option(help="Of everything random; the same seed gives the same bytes.  [default: 0]")
]
WeightsDir = Annotated[Path | None, typer.Option(help="A folder with your own copies of the weights.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]


def configure(preset: str, file: Path | None, settings: list[str] | None, options: dict[str, Any]) -> "Config":
    """The preset, under the file, under the settings, under those `options` that were given (are not None)."""
    from zpm2 import config

    chosen = config.preset(preset)
    if file is not None:
        chosen = config.load(file, chosen)
    given = [f"{name}={value}" for name, value in options.items() if value is not None]
    return config.assign(chosen, [*(settings or []), *given])


def use_weights(directory: Path | None) -> None:
    """Look for weights in a folder of the user's first."""
    if directory is not None:
        if not directory.is_dir():
            raise ConfigError(f"--weights-dir {directory} is no folder: give one that holds weight files")
        os.environ["ZPM2_WEIGHTS"] = str(directory)


@contextmanager
def bars(silent: bool) -> Iterator[tuple[Callable[[str, float], None], Callable[[str], None]]]:
    """A bar per stage on stderr, where that is a terminal, and a voice for single lines; both mute when `silent`."""
    if silent:
        yield lambda stage, share: None, lambda text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description:<8}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        tasks: dict[str, Any] = {}

        def progress(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=1.0)
            shown.update(tasks[stage], completed=share)

        yield progress, console.print


@contextmanager
def fresh_folder(out: Path, *inputs: Path) -> Iterator[Path]:
    """The output folder, tried out; gone again if a run that made it ends in an error and left nothing in it."""
    from zpm2.io.files import output_folder

    fresh = not out.exists()
    output_folder(out, inputs)
    try:
        yield out
    except Zpm2Error:
        if fresh:
            with suppress(OSError):  # not empty: somebody else put something there
                out.rmdir()
        raise
