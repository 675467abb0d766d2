"""`zpm2 app`: point at a region in one photograph and see it in the other, in the browser."""

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from zpm2 import memory
from zpm2.cli.console import warn
from zpm2.cli.options import (
    METHOD,
    RUN,
    AllowVrt,
    Bands,
    ConfigFile,
    Device,
    MaxMemory,
    Points,
    Preset,
    Settings,
    WeightsDir,
    allow_vrt,
    configure,
    one_of,
    registered_segmenters,
    use_weights,
)
from zpm2.errors import ConfigError

LOCAL = "127.0.0.1"


def app(
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LEFT RIGHT | OUT]",
            help="Two photographs, or the folder of a result of zpm2 match. Without them, drop two photographs on the "
            "page.",
        ),
    ] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Only print the address of the page.", rich_help_panel=RUN)
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.", rich_help_panel=RUN)] = 0,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on. Any other than this one opens the page to the network.", rich_help_panel=RUN
        ),
    ] = LOCAL,
    max_upload: Annotated[
        str, typer.Option(metavar="SIZE", help="Largest photograph that the page takes.", rich_help_panel=RUN)
    ] = "500MB",
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="What finds the outlines: mobile_sam or another one that takes prompts.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(registered_segmenters),
        ),
    ] = None,
    points: Points = None,
    bands: Bands = None,
    allowed: AllowVrt = None,
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    device: Device = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
) -> None:
    """Point at a region in one photograph and see it in the other.

    Serves a page on this machine, and on this machine only, until Ctrl-C: click, draw a box or an outline, and correct,
    accept and export what comes back. The address holds a secret token: whoever has it can use the page.
    """
    from zpm2.app.serve import check_installed, serve

    check_installed()
    given = inputs or []
    if len(given) > 2:
        raise ConfigError(f"zpm2 app takes two photographs or one folder, not {len(given)} paths")
    config = configure(
        preset,
        config_file,
        settings,
        segmenter=segmenter,
        points=points,
        bands=bands,
        device=device,
        max_memory=max_memory,
    )
    use_weights(weights_dir)
    allow_vrt(allowed)
    most = _bytes(max_upload)
    if host != LOCAL:
        warn([f"whoever reaches {host} and knows the token can see the photographs; the connection is not encrypted"])
    from zpm2.app.session import made

    session = made(config, lambda text: print(text, file=sys.stderr))
    if len(given) == 2:
        session.open(*given)
    elif given:
        session.open_result(given[0])
    serve(session, host, port, most, lambda address: _tell(address, no_open))


def _bytes(most: str) -> float:
    try:
        if most != memory.AUTO:
            return memory.size(most)
    except ConfigError:
        pass
    raise ConfigError(f"--max-upload {most} is not a size: give a number with a unit (2GB, 500MB), or none")


def _tell(address: str, no_open: bool) -> None:
    print(address, flush=True)
    print("Ctrl-C ends it.", file=sys.stderr)
    if not no_open and not webbrowser.open(address):
        print("no browser was found: open the address yourself", file=sys.stderr)
