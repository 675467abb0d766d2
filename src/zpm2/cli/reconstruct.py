"""`zpm2 reconstruct`: a workspace for `zpm2 cloud` from photographs."""

import json
from pathlib import Path
from typing import Annotated

import typer

from zpm2 import memory
from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import AllowVrt, AsJson, MaxMemory, Out, Quiet, allow_vrt, within


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
        int,
        typer.Option(
            help="px, the longer side of the images that depth is computed on.", callback=within(100, 100_000, " px")
        ),
    ] = 1600,
    neighbors: Annotated[
        int, typer.Option(help="Views that the depth of each view is computed from.", callback=within(1, 1000))
    ] = 3,
    sequence: Annotated[
        bool,
        typer.Option("--sequence", help="The photographs are a sequence: match each with the next ones only."),
    ] = False,
    allowed: AllowVrt = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Reconstruct cameras and a surface from photographs, as a workspace for zpm2 cloud.

    Writes images/, sparse/0 (COLMAP), dense/ (undistorted images, depth and normal maps), fused.ply and mesh.ply. Needs
    pycolmap: pip install "zpm2[colmap,cloud]".
    """
    from zpm2.reconstruct import Options, claimed_names, read_inputs
    from zpm2.reconstruct import reconstruct as run

    allow_vrt(allowed)
    memory.size(max_memory or memory.AUTO)
    memory.limit(max_memory or memory.AUTO)
    given = read_inputs(images, cameras)
    folder = fresh_folder(out, *given.photographs, names=claimed_names(out, given.photographs), kept=".")
    with folder, bars(quiet or as_json) as (progress, _):
        made = run(given.photographs, out, Options(max_size, neighbors, sequence), given.cameras, progress)
    warnings = [*given.warnings, *made.notes]
    warn(warnings)
    if as_json:
        counts = {"registered": made.registered, "photographs": made.photographs, "points": made.points}
        print(json.dumps(counts | {"warnings": warnings, "out": str(out)}))
    elif not quiet:
        print(f"{made.registered} of {made.photographs} photographs oriented, {made.points} points on the surface")
        print(f"Written: {out / 'mesh.ply'}, sparse/0, dense, images; next: zpm2 cloud {out} -o OUT")
