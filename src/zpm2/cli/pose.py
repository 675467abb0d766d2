"""`zpm2 pose`: the relative pose of two photographs from their matched polygons."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    CAMERAS,
    METHOD,
    RESULT,
    AllowVrt,
    AsJson,
    Bands,
    ConfigFile,
    Device,
    MaxMemory,
    Out,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    choices,
    configure,
    one_of,
    positive,
    use_weights,
)
from zpm2.errors import ConfigError, Failed

if TYPE_CHECKING:
    from zpm2.pose import OrientedPair

CENTERS = {"0.5": 0.5, "0": 0.0}  # of the first pixel, px
NO_POSE = 3  # exit code where there is no pose; pose.json is written and says why


def pose(
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    out: Out = Path("zpm2-pose"),
    k: Annotated[
        str | None,
        typer.Option(
            "--K",
            help="Left camera: fx,fy,cx,cy[,k1[,k2[,p1,p2[,k3]]]] of the stored pixels, a matrix file, a COLMAP model, "
            "exif or guess.  [default: exif, else estimated from the points]",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    k2: Annotated[
        str | None, typer.Option("--K2", help="Right camera.  [default: same as the left one]", rich_help_panel=CAMERAS)
    ] = None,
    centers: Annotated[
        str,
        typer.Option(
            help="Coordinate of the first pixel's centre in numbers and matrix files: 0.5, or 0 (OpenCV).",
            rich_help_panel=CAMERAS,
            autocompletion=one_of(lambda: CENTERS),
        ),
    ] = "0.5",
    baseline: Annotated[
        float | None,
        typer.Option(
            help="Distance between the cameras; the translation gets its unit.",
            rich_help_panel=CAMERAS,
            callback=positive("length"),
        ),
    ] = None,
    matches: Annotated[
        Path | None,
        typer.Option(help="Use the matches in this folder of zpm2 match instead of matching.", rich_help_panel=METHOD),
    ] = None,
    rectify: Annotated[
        bool,
        typer.Option(
            "--rectify", help="Write the rectified pair and its polygons (rectified/).", rich_help_panel=RESULT
        ),
    ] = False,
    colmap: Annotated[
        bool,
        typer.Option(
            "--colmap", help="Write a database and a two-view model for COLMAP (colmap/).", rich_help_panel=RESULT
        ),
    ] = False,
    estimator: Annotated[
        str | None,
        typer.Option(
            help="opencv, poselib, or auto (poselib if it is installed).  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(choices("pose.estimator")),
        ),
    ] = None,
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
    """Estimate the relative pose of the two cameras.

    Uses matched polygons and homologous points. Writes pose.json and, unless --matches is given, the files of zpm2
    match. R and t take points of the left camera to the right one: X_right = R X_left + t; t has unit length without
    --baseline. If there is no pose, the exit code is 3 and pose.json says why.
    """
    config = configure(
        preset,
        config_file,
        settings,
        bands=bands,
        device=device,
        seed=seed,
        estimator=estimator,
        max_memory=max_memory,
    )
    if centers not in CENTERS:
        raise ConfigError(f"--centers {centers}: give 0.5 or 0, the coordinate of the first pixel's centre")
    from zpm2.formats.saving import file_names as match_names
    from zpm2.pose import find
    from zpm2.pose.run import check_colmap, file_names

    if colmap:
        check_colmap(left, right)
    use_weights(weights_dir)
    allow_vrt(allowed)
    names = [*file_names(rectify, colmap), *(match_names() if matches is None else [])]
    inputs = left, right, *(Path(text) for text in (k, k2) if text is not None)
    with fresh_folder(out, *inputs, names=names), bars(quiet or as_json) as (progress, say):
        pair = find(
            left,
            right,
            config,
            k=k,
            k2=k2,
            centers=CENTERS[centers],
            baseline=baseline,
            matches=matches,
            matched=lambda result: result.save(out, report=True),
            progress=progress,
            say=say,
        )
        written, missing = pair.save(out, rectified=rectify, as_colmap=colmap)
    warn(missing)
    _report(pair, out, written, quiet, as_json)
    if isinstance(pair.pose.pose, Failed):
        raise typer.Exit(NO_POSE)


def _report(pair: "OrientedPair", out: Path, written: list[Path], quiet: bool, as_json: bool) -> None:
    found = pair.pose
    warn([*pair.matches.warnings, *found.all_warnings()])
    document = found.to_dict()
    if as_json:
        kept = ("cameras", "pose", "failed", "counts", "timings", "warnings")
        print(json.dumps({name: document[name] for name in kept} | {"out": str(out)}))
        return
    if quiet:
        return
    counts = found.counts()
    print(
        f"{counts['inliers']} of {counts['used']} points agree, in {counts['regions_with_inliers']} of "
        f"{counts['regions']} matched regions ({counts['local']} points from crops)"
    )
    if not isinstance(found.pose, Failed):
        for row in found.pose.rotation:
            print("R  " + "  ".join(f"{value: .6f}" for value in row))
        shift = found.translation
        print("t  " + ("none" if shift is None else "  ".join(f"{value: .6f}" for value in shift)))
        turned, moved = found.pose.rotation_sigma, found.pose.translation_sigma
        if turned is None:
            print("standard deviation: unknown (see the warnings)")
        else:
            print(
                f"standard deviation: {turned:.3f} degrees of R"
                + (f", {moved:.3f} degrees of the direction of t" if moved is not None else "")
            )
    print(f"Written: {', '.join(map(str, written))}")
