"""`zpm2 reconstruct`: a workspace for `zpm2 cloud` from photographs."""

import json
from pathlib import Path
from typing import Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    CAMERAS,
    METHOD,
    AllowVrt,
    AsJson,
    ConfigFile,
    MaxMemory,
    Out,
    Preset,
    Quiet,
    Settings,
    allow_vrt,
    configure,
)


def reconstruct(
    images: Annotated[list[Path], typer.Argument(help="A folder of photographs, or the photographs themselves.")],
    out: Out = Path("zpm2-reconstruct"),
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Known cameras: COLMAP model, cameras.npz, or folder of _cam.txt or .camera files.  "
            "[default: structure from motion]",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    max_size: Annotated[
        int | None,
        typer.Option(
            help="Longer side of the images that depth is computed on, px.  [default: preset's]", rich_help_panel=METHOD
        ),
    ] = None,
    neighbors: Annotated[
        int | None,
        typer.Option(
            help="How many other views the depth of a view is computed from.  [default: preset's]",
            rich_help_panel=METHOD,
        ),
    ] = None,
    sequence: Annotated[
        bool,
        typer.Option(
            "--sequence",
            help="The photographs are a sequence: match each only with the next ones.",
            rich_help_panel=METHOD,
        ),
    ] = False,
    allowed: AllowVrt = None,
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Reconstruct cameras and a surface from photographs.

    The result is a workspace for zpm2 cloud: images/, sparse/0 (COLMAP), dense/ (undistorted images, depth and normal
    maps), fused.ply and mesh.ply. Needs pycolmap: pip install "zpm2[colmap,cloud]".
    """
    from zpm2.reconstruct import claimed_names, read_inputs
    from zpm2.reconstruct import reconstruct as run

    config = configure(preset, config_file, settings, max_memory=max_memory)
    given = {"max_size": max_size, "neighbors": neighbors, "ordered": sequence or None}
    config = config.from_dict({"reconstruct": {name: v for name, v in given.items() if v is not None}}, config)
    allow_vrt(allowed)
    inputs = read_inputs(images, cameras)
    folder = fresh_folder(out, *inputs.photographs, names=claimed_names(out, inputs.photographs), kept=".")
    with folder, bars(quiet or as_json) as (progress, _):
        made = run(inputs.photographs, out, config, inputs.cameras, progress)
    warnings = [*inputs.warnings, *made.notes]
    warn(warnings)
    if as_json:
        counts = {"registered": made.registered, "photographs": made.photographs, "points": made.points}
        print(json.dumps(counts | {"warnings": warnings, "out": str(out)}))
    elif not quiet:
        print(f"{made.registered} of {made.photographs} photographs oriented, {made.points} points on the surface")
        print(f"Written: {out / 'mesh.ply'}, sparse/0, dense, images; next: zpm2 cloud {out} -o OUT")
