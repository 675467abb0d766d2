"""`zpm2 reconstruct`: a workspace for `zpm2 cloud` from photographs."""

import json
from pathlib import Path
from typing import Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
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
    images: Annotated[list[Path], typer.Argument(help="A folder of photographs, or photographs.")],
    out: Out = Path("zpm2-reconstruct"),
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Known cameras: COLMAP model, cameras.npz, folder of _cam.txt or .camera files. "
            "[default: structure from motion]"
        ),
    ] = None,
    max_size: Annotated[
        int | None,
        typer.Option(help="px, the longer side of the images that depth is computed on.  [default: preset's]"),
    ] = None,
    neighbors: Annotated[
        int | None, typer.Option(help="Views that the depth of each view is computed from.  [default: preset's]")
    ] = None,
    sequence: Annotated[
        bool,
        typer.Option("--sequence", help="The photographs are a sequence: match each with the next ones only."),
    ] = False,
    allowed: AllowVrt = None,
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Reconstruct cameras and a surface from photographs, as a workspace for zpm2 cloud.

    Writes images/, sparse/0 (COLMAP), dense/ (undistorted images, depth and normal maps), fused.ply and mesh.ply. Needs
    pycolmap: pip install "zpm2[colmap,cloud]".
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
