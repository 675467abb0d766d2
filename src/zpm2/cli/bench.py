"""`zpm2 bench`: how fast pairs are matched here."""

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from zpm2.cli.console import bars
from zpm2.cli.doctor import examine
from zpm2.cli.options import (
    RESULT,
    RUN,
    ConfigFile,
    Device,
    MaxMemory,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    configure,
    use_weights,
)
from zpm2.errors import ConfigError

SAID = "zpm2", "python", "torch", "openvino", "numpy", "shapely"  # of the versions that zpm2 doctor prints


def bench(
    photographs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[LEFT RIGHT]...", help="Pairs of photographs.  [default: the pair of zpm2 demo]"),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, metavar="N", help="Warm runs of each pair.", rich_help_panel=RUN)] = 5,
    many: Annotated[
        bool, typer.Option("--many", help="Also many pairs at once, by Matcher.match_many.", rich_help_panel=RUN)
    ] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the report as JSON.", rich_help_panel=RESULT)
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A report of an earlier run to compare with.", rich_help_panel=RESULT),
    ] = None,
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
) -> None:
    """Measure how fast pairs are matched, stage by stage.

    Each pair is matched once, which loads the networks, and then --runs times, whose medians count.
    """
    from zpm2.evaluate import rendered, speed
    from zpm2.files.writing import check_place

    given = photographs or []
    if len(given) % 2:
        raise ConfigError(f"zpm2 bench takes pairs, LEFT RIGHT each: {len(given)} photographs are given")
    config = configure(preset, config_file, settings, device=device, seed=seed, max_memory=max_memory)
    use_weights(weights_dir)
    if json_file:
        check_place(json_file)
    before = speed.Speed.load(compare) if compare else None
    found = examine()
    environment = {name: found["versions"][name] for name in SAID} | {"preset": preset, **found["devices"]}
    with tempfile.TemporaryDirectory() as folder, bars(quiet) as (progress, say):
        pairs = list(zip(given[::2], given[1::2], strict=True))
        if not pairs:
            pairs = [rendered.save_scene(rendered.render_scene(config.seed), Path(folder))]
        measured = speed.measure(pairs, config, runs, many, environment, progress, say)
    if not quiet:
        print(speed.text(measured, before))
    if json_file:
        measured.save(json_file)
