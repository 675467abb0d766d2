"""`zpm2 cloud`: matched polygons lifted onto a surface."""

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2.cli.console import (
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
    configure,
    fresh_folder,
    given_matches,
    use_weights,
)
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.model.messages import about

if TYPE_CHECKING:
    from zpm2.api import Matcher
    from zpm2.cloud import MatchedPair, PolygonCloud, RayCaster, Surface, View
    from zpm2.config import Config
    from zpm2.result import MatchResult
    from zpm2.stereo.rig import Rig

WORKSPACE = "A workspace"  # groups of options in the help
STEREO = "A rectified pair"
PAIRS = "pairs"  # folder of the matches of each pair
UNMATCHED = ("cloud", "pose", "device")  # stages of a configuration that do not change matches


def cloud(
    inputs: Annotated[
        list[Path], typer.Argument(help="A workspace (photographs, cameras, mesh), or with --stereo two photographs.")
    ],
    out: Out = Path("zpm2-cloud"),
    mesh: Annotated[
        Path | None, typer.Option(help="The mesh, where the workspace has none or several.", rich_help_panel=WORKSPACE)
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(help="Folder of the photographs, if not in the usual place.", rich_help_panel=WORKSPACE),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="COLMAP model, cameras.npz, or folder of _cam.txt or .camera files.", rich_help_panel=WORKSPACE
        ),
    ] = None,
    stereo: Annotated[
        bool,
        typer.Option(
            "--stereo", help="Take the surface from a rectified, calibrated pair alone.", rich_help_panel=STEREO
        ),
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
        str | None, typer.Option("--K2", help="The right camera.  [default: as the left one]", rich_help_panel=STEREO)
    ] = None,
    baseline: Annotated[
        float | None,
        typer.Option(help="With --K: distance of the cameras, in the unit of the cloud.", rich_help_panel=STEREO),
    ] = None,
    disparity: Annotated[
        Path | None,
        typer.Option(help="With --stereo: disparity of the left image (.pfm, .png, .npy).", rich_help_panel=STEREO),
    ] = None,
    disparity_scale: Annotated[
        float, typer.Option(help="What the values of --disparity are divided by.", rich_help_panel=STEREO)
    ] = 1.0,
    disparity_sign: Annotated[int, typer.Option(help="-1 where --disparity stores -d.", rich_help_panel=STEREO)] = 1,
    matches: Annotated[
        Path | None,
        typer.Option(help="With --stereo: take the matches of this folder of zpm2 match.", rich_help_panel=STEREO),
    ] = None,
    non_overlapping: Annotated[
        bool,
        typer.Option("--non-overlapping", help="Every pixel belongs to one match at most.", rich_help_panel=RESULT),
    ] = False,
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Of the sampled points, in the mesh's unit.  [default: 200,000 points]", rich_help_panel=RESULT
        ),
    ] = None,
    las: Annotated[bool, typer.Option("--las", help="Write points.las too.", rich_help_panel=RESULT)] = False,
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
    """Lift the matched polygons of photographs onto a surface: a polygon cloud.

    Writes cloud.json, cloud.html to look at, cloud.png, patches.ply, cloud.glb, boundaries and points. The matches of
    each pair stay in pairs/, and are taken from there by the next run.
    """
    options = {"bands": bands, "device": device, "seed": seed, "max_memory": max_memory}
    config = configure(preset, config_file, settings, options)
    if spacing is not None and not 0 < spacing < float("inf"):
        raise ConfigError(f"--spacing {spacing}: give a distance above 0")
    if not 0 < disparity_scale < float("inf"):
        raise ConfigError(f"--disparity-scale {disparity_scale}: give a number above 0")
    if disparity_sign not in (1, -1):
        raise ConfigError(f"--disparity-sign {disparity_sign}: give 1, or -1 where the file stores -d")
    only_stereo = {"--calib": calib, "--K": k, "--K2": k2, "--baseline": baseline, "--disparity": disparity}
    _refuse(stereo, only_stereo | {"--matches": matches}, {"--mesh": mesh, "--images": images, "--cameras": cameras})
    if len(inputs) != (2 if stereo else 1):
        raise ConfigError("give one workspace, or two photographs with --stereo")
    from zpm2.cloud import save
    from zpm2.cloud.export import require_laspy
    from zpm2.cloud.save import NAMES
    from zpm2.cloud.surface import require_trimesh

    require_trimesh()
    if las:
        require_laspy()
    use_weights(weights_dir)
    allow_vrt(allowed)
    names = [*NAMES, "mesh.ply"] if stereo else NAMES
    names = [*names, *([] if matches else [PAIRS])]
    given = mesh, images, cameras, calib, disparity, *(Path(text) for text in (k, k2) if text is not None)
    folder = fresh_folder(out, *inputs, *given, names=names, kept=PAIRS)
    with folder, bars(quiet or as_json) as (progress, say):
        matcher = _Matcher(config, progress, say, out)
        if stereo:
            rig = _rig(calib, k, k2, baseline, inputs)
            found = _stereo(
                matcher, inputs, rig, disparity, (disparity_scale, disparity_sign), matches, non_overlapping
            )
        else:
            found = _workspace(matcher, inputs[0], mesh, images, cameras, non_overlapping)
        progress("save", 0.0)
        missing = save(found, out, spacing, las)
        progress("save", 1.0)
    _report(found, missing, out, quiet, as_json)
    if not found.patches:
        raise typer.Exit(1)


def _refuse(stereo: bool, only_stereo: dict[str, Any], only_workspace: dict[str, Any]) -> None:
    for name, value in (only_workspace if stereo else only_stereo).items():
        if value is not None:
            raise ConfigError(f"{name} is for {'a workspace, not for --stereo' if stereo else '--stereo'}")


class _Matcher:
    """Matches pairs, keeps them in pairs/ of the output folder, and takes from there what is there already."""

    def __init__(
        self, config: "Config", progress: Callable[[str, float], None], say: Callable[[str], None], out: Path
    ) -> None:
        self.config, self.progress, self.say, self.out = config, progress, say, out
        self._matcher: Matcher | None = None

    def __call__(self, left: Path, right: Path, names: tuple[str, str]) -> "MatchResult":
        from zpm2.files.keys import key
        from zpm2.files.record import make_folder, save_key, saved_key
        from zpm2.result import MatchResult

        name = "-".join(str(Path(name).with_suffix("")).replace("/", "_") for name in names)
        folder, asked = self.out / PAIRS / name, key([left, right], _asked(self.config.to_dict()))
        if saved_key(folder) == asked and (folder / "matches.json").exists():
            return MatchResult.load(folder)
        if self._matcher is None:
            from zpm2.api import Matcher

            self._matcher = Matcher(self.config, progress=self.progress, say=self.say)
        make_folder(self.out / PAIRS)
        self._matcher(left, right).save(make_folder(folder))
        save_key(folder, asked)
        return MatchResult.load(folder)  # without the pixels


def _asked(config: dict[str, Any]) -> dict[str, Any]:
    """The part of a configuration that makes matches."""
    return {name: value for name, value in config.items() if name not in UNMATCHED}


def _workspace(
    matcher: _Matcher, folder: Path, mesh: Path | None, images: Path | None, cameras: Path | None, exclusive: bool
) -> "PolygonCloud":
    from zpm2.cloud import MatchedPair, Surface, neighbor_pairs
    from zpm2.cloud.workspace import find_mesh, read_views

    odd = list[str]()
    views = read_views(folder, images, cameras, odd)
    matcher.progress("mesh", 0.0)
    surface = _filled(Surface.read(mesh or find_mesh(folder)), matcher.config)
    matcher.progress("mesh", 1.0)
    caster = _caster(surface)
    chosen = neighbor_pairs([view.camera for view in views], surface, caster, matcher.config.cloud.neighbors)
    pairs = []
    for k, (i, j) in enumerate(chosen):
        matcher.progress("pairs", k / len(chosen))
        result = matcher(views[i].path, views[j].path, (views[i].name, views[j].name))
        pairs.append(MatchedPair(i, j, result.flatten() if exclusive else result))
    matcher.progress("pairs", 1.0)
    return _built(views, pairs, surface, caster, matcher, odd)


def _stereo(
    matcher: _Matcher,
    photographs: list[Path],
    rig: "Rig",
    disparity: Path | None,
    scaling: tuple[float, int],
    matches: Path | None,
    exclusive: bool,
) -> "PolygonCloud":
    from zpm2.cloud import MatchedPair, View
    from zpm2.cloud.disparity_mesh import disparity_mesh
    from zpm2.cloud.export import write_surface
    from zpm2.formats.maps import read_disparity
    from zpm2.photos.images import read_image
    from zpm2.stereo import dense
    from zpm2.stereo.camera_check import doubts

    raster = matcher.config.raster
    left, right = (read_image(p, f"{n} image", raster) for p, n in zip(photographs, ("left", "right"), strict=True))
    odd = [*doubts(rig.left, "the left camera"), *doubts(rig.right, "the right camera")]
    given = read_disparity(disparity, (left.width, left.height), *scaling) if disparity is not None else None
    names = photographs[0].name, photographs[1].name
    if matches is not None:
        result = given_matches(matches, photographs, (left, right))
    else:
        result = matcher(photographs[0], photographs[1], names)
    matcher.progress("mesh", 0.0)
    if given is None:
        bounds = dense.disparity_range(result.points.left[:, 0] - result.points.right[:, 0], left.width)
        if isinstance(bounds, Failed):
            raise InputError(f"no surface from this pair: {bounds}; give --disparity")
        given = dense.semi_global(left, right, *bounds)
    else:
        dense.refuse_other_disparity(given, result.points.left, result.points.right)
    surface = _filled(disparity_mesh(given, rig), matcher.config)
    write_surface(surface, matcher.out / "mesh.ply")
    matcher.progress("mesh", 1.0)
    views = [View(path.name, path, camera) for path, camera in zip(photographs, rig.views, strict=True)]
    pairs = [MatchedPair(0, 1, result.flatten() if exclusive else result)]
    return _built(views, pairs, surface, _caster(surface), matcher, odd)


def _filled(surface: "Surface", config: "Config") -> "Surface":
    from zpm2.cloud.holes import fill_holes

    return fill_holes(surface, config.cloud.fill * surface.extent)


def _caster(surface: "Surface") -> "RayCaster":
    """Of a surface; that it is slow is said before the waiting begins."""
    from zpm2.cloud import open_caster

    caster = open_caster(surface)
    if caster.note:
        print(f"warning: {caster.note}", file=sys.stderr)
    return caster


def _built(
    views: "list[View]",
    pairs: "list[MatchedPair]",
    surface: "Surface",
    caster: "RayCaster",
    matcher: _Matcher,
    odd: list[str],
) -> "PolygonCloud":
    """The cloud, with what is `odd` about the cameras among its warnings."""
    from zpm2.cloud import build

    made = build(views, pairs, surface, caster, matcher.config.cloud, matcher.progress)
    warnings, notes = [*odd, *made.warnings], list(made.notes)
    for pair in pairs:
        names = f"{views[pair.left].name}, {views[pair.right].name}"
        warnings += about(names, pair.result.warnings)
        notes += about(names, pair.result.notes)
    return dataclasses.replace(made, config=matcher.config.to_dict(), warnings=warnings, notes=notes)


def _rig(calib: Path | None, k: str | None, k2: str | None, baseline: float | None, photographs: list[Path]) -> "Rig":
    from zpm2.photos.listing import image_size
    from zpm2.stereo.calibration import read_calibration
    from zpm2.stereo.camera_check import checked, fitting_size
    from zpm2.stereo.intrinsics import read_camera
    from zpm2.stereo.rig import rig_of

    if calib is not None:
        if any(value is not None for value in (k, k2, baseline)):
            raise ConfigError("--calib holds the cameras and the baseline: leave --K, --K2 and --baseline out")
        rig = read_calibration(calib, image_size(photographs[0]))
        for name, camera, path in zip(("left", "right"), (rig.left, rig.right), photographs, strict=True):
            what = f"the {name} camera of {calib}"
            checked(fitting_size(camera, image_size(path), what, str(path)), what, str(path))
        return rig
    if k is None or baseline is None:
        raise ConfigError("--stereo needs the cameras: give --calib, or --K and --baseline")
    if not 0 < baseline < float("inf"):
        raise ConfigError(f"--baseline {baseline}: give a length above 0")
    texts = k, k2 or k
    left, right = (
        read_camera(text, path, image_size(path), name=name)
        for text, path, name in zip(texts, photographs, ("K", "K2"), strict=True)
    )
    return rig_of(left, right, baseline)


def _report(found: "PolygonCloud", missing: list[str], out: Path, quiet: bool, as_json: bool) -> None:
    for warning in [*found.warnings, *missing]:
        print(f"warning: {warning}", file=sys.stderr)
    if as_json:
        summary = {"counts": found.counts(), "timings": dict(found.timings), "warnings": list(found.warnings)}
        summary["notes"] = list(found.notes)
        print(json.dumps(summary | {"out": str(out)}))
        return
    if quiet:
        return
    print(
        f"{len(found.patches)} polygons on the surface, of {found.accepted} of {found.matches} matches in "
        f"{len(found.views)} views; they cover {100 * found.coverage:.0f} % of what the views see of it"
    )
    for reason, count in found.reasons().items():
        print(f"{count:6d} rejected: {reason}")
    print(f"Written: {out / 'cloud.html'}, cloud.json, cloud.png, patches.ply, cloud.glb, boundaries, points")
