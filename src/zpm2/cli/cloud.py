"""`zpm2 cloud`: matched polygons lifted onto a surface."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    RESULT,
    AllowVrt,
    AsJson,
    Bands,
    ConfigFile,
    Device,
    MaxMemory,
    NonOverlapping,
    Out,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    configure,
    positive,
    use_weights,
)
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.cloud import PolygonCloud

WORKSPACE = "A workspace"  # groups of options in the help
STEREO = "A rectified pair"
PAIRS, MESH = "pairs", "mesh.ply"  # in the output folder: matches of each pair, surface of a rectified pair


def cloud(
    inputs: Annotated[
        list[Path], typer.Argument(help="A workspace (photographs, cameras, mesh), or with --stereo two photographs.")
    ],
    out: Out = Path("zpm2-cloud"),
    mesh: Annotated[
        Path | None, typer.Option(help="The mesh, if the workspace has none or several.", rich_help_panel=WORKSPACE)
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(help="Folder of the photographs, if they are not in the usual place.", rich_help_panel=WORKSPACE),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Cameras: COLMAP model, cameras.npz, or folder of _cam.txt or .camera files.",
            rich_help_panel=WORKSPACE,
        ),
    ] = None,
    stereo: Annotated[
        bool,
        typer.Option("--stereo", help="Compute the surface from a rectified, calibrated pair.", rich_help_panel=STEREO),
    ] = False,
    calib: Annotated[
        Path | None,
        typer.Option(help="With --stereo: calibration file of Middlebury or KITTI.", rich_help_panel=STEREO),
    ] = None,
    k: Annotated[
        str | None,
        typer.Option(
            "--K", help="With --stereo: fx,fy,cx,cy of the left camera, as for zpm2 pose.", rich_help_panel=STEREO
        ),
    ] = None,
    k2: Annotated[
        str | None,
        typer.Option("--K2", help="The right camera.  [default: same as the left one]", rich_help_panel=STEREO),
    ] = None,
    baseline: Annotated[
        float | None,
        typer.Option(
            help="With --K: distance between the cameras; the cloud gets its unit.",
            rich_help_panel=STEREO,
            callback=positive("length"),
        ),
    ] = None,
    disparity: Annotated[
        Path | None,
        typer.Option(help="With --stereo: disparity of the left image (.pfm, .png, .npy).", rich_help_panel=STEREO),
    ] = None,
    disparity_scale: Annotated[
        float | None,
        typer.Option(
            help="Divide the values of --disparity by this.  [default: 1]",
            rich_help_panel=STEREO,
            callback=positive("number"),
        ),
    ] = None,
    disparity_sign: Annotated[
        int | None,
        typer.Option(help="1, or -1 if --disparity stores -d.  [default: 1]", rich_help_panel=STEREO),
    ] = None,
    matches: Annotated[
        Path | None,
        typer.Option(help="With --stereo: use the matches in this folder of zpm2 match.", rich_help_panel=STEREO),
    ] = None,
    non_overlapping: NonOverlapping = False,
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance between sampled points, in the mesh's unit.  [default: 200,000 points in all]",
            rich_help_panel=RESULT,
            callback=positive("distance"),
        ),
    ] = None,
    las: Annotated[bool, typer.Option("--las", help="Also write points.las.", rich_help_panel=RESULT)] = False,
    bands: Bands = None,
    allowed: AllowVrt = None,
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Lift matched polygons onto a 3D surface: a polygon cloud.

    Writes cloud.json, cloud.html (open it in a browser), cloud.png, patches.ply, cloud.glb, boundaries and points. It
    keeps the matches of each pair in pairs/, and the next run uses them again.
    """
    config = configure(preset, config_file, settings, bands=bands, device=device, seed=seed, max_memory=max_memory)
    only_stereo = {"--calib": calib, "--K": k, "--K2": k2, "--baseline": baseline, "--disparity": disparity}
    _refuse(stereo, only_stereo | {"--matches": matches}, {"--mesh": mesh, "--images": images, "--cameras": cameras})
    scale, sign = 1.0 if disparity_scale is None else disparity_scale, 1 if disparity_sign is None else disparity_sign
    if len(inputs) != (2 if stereo else 1):
        raise ConfigError("give one workspace, or two photographs with --stereo")
    from zpm2 import cloud as clouds
    from zpm2.cloud.export import require_laspy, write_surface
    from zpm2.cloud.run import check_sign
    from zpm2.cloud.save import NAMES
    from zpm2.cloud.surface import require_trimesh

    check_sign(sign, f"--disparity-sign {sign}")
    if disparity is None:
        for name, value in {"--disparity-scale": disparity_scale, "--disparity-sign": disparity_sign}.items():
            if value is not None:
                raise ConfigError(f"{name} needs --disparity")
    require_trimesh()
    if las:
        require_laspy()
    use_weights(weights_dir)
    allow_vrt(allowed)
    names = [*NAMES, *([MESH] if stereo else []), *([] if matches else [PAIRS])]
    given = mesh, images, cameras, calib, disparity, *(Path(text) for text in (k, k2) if text is not None)
    folder = fresh_folder(out, *inputs, *given, names=names, kept=PAIRS)
    with folder, bars(quiet or as_json) as (progress, say):
        if stereo:
            found = clouds.from_stereo(
                inputs[0],
                inputs[1],
                clouds.read_rig(inputs[0], inputs[1], calibration=calib, k=k, k2=k2, baseline=baseline),
                config,
                disparity=clouds.DisparityFile(disparity, scale, sign) if disparity else None,
                matches=matches,
                non_overlapping=non_overlapping,
                kept=out / PAIRS,
                progress=progress,
                say=say,
            )
            write_surface(found.surface, out / MESH)
        else:
            found = clouds.from_workspace(
                inputs[0],
                config,
                mesh=mesh,
                images=images,
                cameras=cameras,
                non_overlapping=non_overlapping,
                kept=out / PAIRS,
                progress=progress,
                say=say,
            )
        progress("save", 0.0)
        missing = clouds.save(found, out, spacing, las)
        progress("save", 1.0)
    _report(found, missing, out, quiet, as_json)
    if not found.patches:
        raise typer.Exit(1)


def _refuse(stereo: bool, only_stereo: Mapping[str, object], only_workspace: Mapping[str, object]) -> None:
    for name, value in (only_workspace if stereo else only_stereo).items():
        if value is not None:
            raise ConfigError(f"{name} is for a workspace: leave out --stereo" if stereo else f"{name} needs --stereo")


def _report(found: "PolygonCloud", missing: list[str], out: Path, quiet: bool, as_json: bool) -> None:
    warn([*found.warnings, *missing])
    if as_json:
        summary = {"counts": found.counts(), "timings": dict(found.timings), "warnings": list(found.warnings)}
        summary["notes"] = list(found.notes)
        print(json.dumps(summary | {"out": str(out)}))
        return
    if quiet:
        return
    print(
        f"{len(found.patches)} polygons on the surface, from {found.accepted} of {found.matches} matches in "
        f"{len(found.views)} views; they cover {100 * found.coverage:.0f} % of the surface that the views see"
    )
    if found.events:
        print(f"{len(found.events)} times one view has one polygon where another one has several")
    for reason, count in found.reasons().items():
        print(f"{count:6d} rejected: {reason}")
    print(f"Written: {out / 'cloud.html'}, cloud.json, cloud.png, patches.ply, cloud.glb, boundaries, points")
