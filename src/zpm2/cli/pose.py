"""`zpm2 pose`: the relative pose of two photographs from their matched polygons."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2 import memory
from zpm2.cli.console import (
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
    bars,
    choices,
    configure,
    fresh_folder,
    given_matches,
    one_of,
    use_weights,
)
from zpm2.errors import ConfigError, Failed

if TYPE_CHECKING:
    from zpm2.model import Camera
    from zpm2.pose import PoseResult
    from zpm2.result import MatchResult

CENTERS = {"0.5": 0.5, "0": 0.0}
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
        str | None, typer.Option("--K2", help="Right camera.  [default: as the left one]", rich_help_panel=CAMERAS)
    ] = None,
    centers: Annotated[
        str,
        typer.Option(
            help="Where numbers and matrix files have the centre of the first pixel: 0.5, or 0 (OpenCV).",
            rich_help_panel=CAMERAS,
            autocompletion=one_of(lambda: CENTERS),
        ),
    ] = "0.5",
    baseline: Annotated[
        float | None,
        typer.Option(
            help="Distance of the cameras, in the unit that the translation shall have.", rich_help_panel=CAMERAS
        ),
    ] = None,
    matches: Annotated[
        Path | None,
        typer.Option(help="Take the matches of this folder of zpm2 match instead of matching.", rich_help_panel=METHOD),
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
            help="opencv or poselib.  [default: preset's]",
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
    """Estimate the relative pose of two photographs from their matched polygons.

    Writes pose.json, and the files of zpm2 match where it matched. R and t take points of the left camera to the right
    one: X_right = R X_left + t, t of unit length where no baseline is given. The exit code is 3 where there is no pose;
    pose.json then says why.
    """
    options = {"bands": bands, "device": device, "seed": seed, "estimator": estimator, "max_memory": max_memory}
    config = configure(preset, config_file, settings, options)
    if centers not in CENTERS:
        raise ConfigError(f"--centers {centers}: pixel centres are counted from 0.5 or from 0")
    if baseline is not None and not 0 < baseline < float("inf"):
        raise ConfigError(f"--baseline {baseline}: give a length above 0")
    if colmap:
        from zpm2.files.listing import distinct_names
        from zpm2.formats.colmap import require_pycolmap

        require_pycolmap()
        if len(set(distinct_names([left, right]))) < 2:
            raise ConfigError(f"--colmap needs two photographs, {left} is given twice")
    use_weights(weights_dir)
    allow_vrt(allowed)

    from zpm2.api import Matcher
    from zpm2.formats.saving import file_names
    from zpm2.photos.images import read_image
    from zpm2.pose import PoseFinder
    from zpm2.pose.result import NAME as POSE
    from zpm2.runtime import resolve_device

    finder = PoseFinder(config, device=resolve_device(config.device))
    raster = config.raster
    images = read_image(left, "left image", raster), read_image(right, "right image", raster)
    cameras = _cameras((k, k2), (left, right), [(i.width, i.height) for i in images], CENTERS[centers])
    names = [POSE, *(["rectified"] if rectify else []), *(["colmap"] if colmap else [])]
    inputs = left, right, *(Path(text) for text in (k, k2) if text is not None)
    folder = fresh_folder(out, *inputs, names=[*names, *(file_names() if matches is None else [])])
    held = memory.reserved(sum(image.rgb.nbytes for image in images))
    with folder, held, bars(quiet or as_json) as (progress, say):
        if matches is None:
            matched = Matcher(config, progress=progress, say=say)(left, right)
            matched.save(out)
        else:
            matched = given_matches(matches, (left, right), images)
        progress("pose", 0.0)
        found = finder(matched, cameras, images)
        found = found.with_baseline(baseline) if baseline is not None else found
        extra = []
        if rectify:
            extra += _rectified(found, images, matched, out)
        if colmap:
            extra += _colmap(found, (left, right), out)
        found.save(out)
        progress("pose", 1.0)
    _report(found, matched, out, extra, quiet, as_json)
    if isinstance(found.pose, Failed):
        raise typer.Exit(NO_POSE)


def _cameras(
    texts: tuple[str | None, str | None], paths: tuple[Path, Path], sizes: list[tuple[int, int]], centers: float
) -> "tuple[Camera, Camera] | None":
    """The cameras that were given, or those that EXIF tells; None where neither does."""
    from zpm2.stereo.intrinsics import from_exif, read_camera, refuse_swapped

    if texts[0] is None:
        if texts[1] is not None:
            raise ConfigError("--K2 without --K: give both, or --K alone for two images of one camera")
        first, second = (from_exif(path, size) for path, size in zip(paths, sizes, strict=True))
        return None if isinstance(first, Failed) or isinstance(second, Failed) else (first, second)
    if texts[1] is None and sizes[0] != sizes[1] and texts[0] not in ("exif", "guess"):
        raise ConfigError(f"the images have {_size(sizes[0])} and {_size(sizes[1])} px: give --K2 for the right one")
    both = texts[0], texts[1] or texts[0]
    left, right = (
        read_camera(text, path, size, centers, name)
        for text, path, size, name in zip(both, paths, sizes, ("K", "K2"), strict=True)
    )
    refuse_swapped((left, right))
    return left, right


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _rectified(found: "PoseResult", images: Any, matched: "MatchResult", out: Path) -> list[str]:
    import cv2

    from zpm2.files.record import make_folder
    from zpm2.files.writing import atomic_write
    from zpm2.formats import geojson
    from zpm2.model import SIDES, counterparts
    from zpm2.pose import rectify

    pair = rectify(found, images, matched.matched_polygons())
    if isinstance(pair, Failed):
        print(f"warning: not rectified: {pair}", file=sys.stderr)
        return []
    folder = make_folder(out / "rectified")
    for name, side in zip(SIDES, (pair.left, pair.right), strict=True):
        picture = cv2.cvtColor(side.image.rgb, cv2.COLOR_RGB2BGR)
        atomic_write(folder / f"{name}.png", cv2.imencode(".png", picture)[1].tobytes())
        size = side.camera.size
        partners = counterparts(matched.matches, name)
        collection = geojson.feature_collection(side.polygons, partners, f"{name}.png", size[0], size[1])
        geojson.write(folder / f"{name}.geojson", collection)
    atomic_write(folder / "rectification.json", json.dumps(pair.to_dict()))
    return [str(folder)]


def _colmap(found: "PoseResult", paths: tuple[Path, Path], out: Path) -> list[str]:
    from zpm2.files.listing import distinct_names
    from zpm2.files.record import make_folder
    from zpm2.pose import colmap

    if isinstance(found.pose, Failed) or found.translation is None:
        print("warning: no COLMAP model: there is no pose with a translation", file=sys.stderr)
        return []
    left, right = distinct_names(paths)
    return [str(colmap.write(found, (left, right), make_folder(out / "colmap")))]


def _report(
    found: "PoseResult", matched: "MatchResult", out: Path, extra: list[str], quiet: bool, as_json: bool
) -> None:
    said = found.all_warnings()
    for warning in [*matched.warnings, *said]:
        print(f"warning: {warning}", file=sys.stderr)
    document = found.to_dict()
    if as_json:
        kept = ("cameras", "pose", "failed", "counts", "timings", "warnings")
        print(json.dumps({name: document[name] for name in kept} | {"out": str(out)}))
        return
    if quiet:
        return
    counts = document["counts"]
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
            print("one standard deviation: not known, this may be quite another pose (see the warnings)")
        else:
            print(
                f"one standard deviation: {turned:.3f} degrees of R"
                + (f", {moved:.3f} degrees of the direction of t" if moved is not None else "")
            )
    print(f"Written: {', '.join([str(out / 'pose.json'), *extra])}")
