"""`zpm2 reconstruct`: a workspace for `zpm2 cloud` from photographs."""

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from zpm2.cli.console import (
    AllowVrt,
    AsJson,
    ConfigFile,
    MaxMemory,
    Out,
    Preset,
    Quiet,
    Settings,
    allow_vrt,
    bars,
    configure,
    fresh_folder,
)
from zpm2.errors import ConfigError


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
        typer.Option("--sequence", help="The photographs are a sequence: each is matched with the next ones."),
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
    config = configure(preset, config_file, settings, {"max_memory": max_memory})
    given = {"max_size": max_size, "neighbors": neighbors, "ordered": sequence or None}
    given = {name: value for name, value in given.items() if value is not None}
    config = config.from_dict({"reconstruct": given}, config)
    allow_vrt(allowed)
    from zpm2.cloud.workspace import read_views
    from zpm2.files.listing import distinct_names
    from zpm2.photos.images import read_image
    from zpm2.photos.listing import some_photographs
    from zpm2.reconstruct import claimed_names
    from zpm2.reconstruct import reconstruct as run

    known, odd = None, list[str]()
    if cameras is not None:
        if len(images) != 1 or not os.path.isdir(images[0]):
            raise ConfigError("--cameras needs one folder of photographs")
        views = read_views(images[0], images[0], cameras, odd)
        paths = [view.path for view in views]
        known = {name: view.camera for name, view in zip(distinct_names(paths), views, strict=True)}
    else:
        paths = some_photographs(images[0]) if len(images) == 1 and not os.path.isfile(images[0]) else images
    for path in paths:
        read_image(path)  # one line for what cannot be read, before anything is written
    folder = fresh_folder(out, *paths, names=claimed_names(out, paths), kept=".")
    with folder, bars(quiet or as_json) as (progress, _):
        made = run(paths, out, config, known, progress)
    notes = [*odd, *made.notes]
    for note in notes:
        print(f"warning: {note}", file=sys.stderr)
    if as_json:
        kept = {"registered": made.registered, "photographs": made.photographs, "points": made.points}
        print(json.dumps(kept | {"warnings": notes, "out": str(out)}))
    elif not quiet:
        print(f"{made.registered} of {made.photographs} photographs oriented, {made.points} points on the surface")
        print(f"Written: {out / 'mesh.ply'}, sparse/0, dense, images; next: zpm2 cloud {out} -o OUT")
