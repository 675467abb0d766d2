"""The command line: `zpm2 match`, `pose`, `cloud`, `reconstruct`, `eval`, `demo`, `doctor`, `weights`."""

import json
import shutil
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2._version import __version__
from zpm2.cloud_cli import cloud
from zpm2.console import (
    AsJson,
    Bands,
    ConfigFile,
    Device,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    bars,
    configure,
    fresh_folder,
    use_weights,
)
from zpm2.errors import ConfigError, Zpm2Error
from zpm2.eval_cli import evaluate
from zpm2.methods import check_method, open_method
from zpm2.pose_cli import pose
from zpm2.reconstruct_cli import reconstruct
from zpm2.weights_cli import app as weights_app

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.detect.protocol import Segmenter
    from zpm2.result import MatchResult

app = typer.Typer(
    help="Match polygons between two overlapping photographs.", no_args_is_help=True, rich_markup_mode=None
)
app.add_typer(weights_app, name="weights")
app.command("eval")(evaluate)
app.command("pose")(pose)
app.command("cloud")(cloud)
app.command("reconstruct")(reconstruct)

# Base of typer's usage errors: click's class, or that of the click which newer typers carry inside.
UsageError: Any = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")

SEGMENTERS = ("mobile_sam", "vit_b", "vit_l", "vit_h", "precomputed")


def main() -> None:
    """Entry point. Misuse prints one line and exits with 2; an interrupt exits with 130."""
    try:
        status = app(prog_name="zpm2", standalone_mode=False)
    except Zpm2Error as error:
        sys.exit(_complain(str(error)))
    except UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message(), file=sys.stderr)
            sys.exit(2)
        sys.exit(_complain(f"{error.format_message().rstrip('.')}; see zpm2 --help"))
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def _complain(text: str) -> int:
    print(f"zpm2: {' '.join(text.split())}", file=sys.stderr)
    return 2


@app.callback(invoke_without_command=True)
def root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Match polygons between two overlapping photographs."""
    if version:
        print(__version__)
        raise typer.Exit


@app.command("match")
def match_command(
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")],
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    segmenter: Annotated[
        str | None, typer.Option(help="mobile_sam, vit_b, vit_l, vit_h, or precomputed (your own regions).")
    ] = None,
    quality: Annotated[
        str | None, typer.Option(help="fast, balanced or full: how many of the prompts are asked.  [default: preset's]")
    ] = None,
    left_regions: Annotated[Path | None, typer.Option(help="Label image, COCO JSON or GeoJSON, left.")] = None,
    right_regions: Annotated[Path | None, typer.Option(help="The same, right.")] = None,
    method: Annotated[str, typer.Option(help="zpm2, or a classical baseline: shape-context, idsc.")] = "zpm2",
    points: Annotated[str | None, typer.Option(help="Point matchers, comma separated: xfeat,sift.")] = None,
    non_overlapping: Annotated[
        bool, typer.Option("--non-overlapping", help="Give each pixel to one match at most.")
    ] = False,
    outlines: Annotated[
        bool, typer.Option("--outlines", help="Pair the outlines of each match, point by point, in matches.json.")
    ] = False,
    tiles: Annotated[
        str | None, typer.Option(help="auto, on or off: large photographs tile by tile.  [default: preset's]")
    ] = None,
    bands: Bands = None,
    gsd: Annotated[
        str | None, typer.Option(help="m on the ground per px, one or left,right.  [default: as the files say]")
    ] = None,
    min_area_m2: Annotated[
        float | None, typer.Option("--min-area-m2", help="Leave out polygons smaller than this on the ground.")
    ] = None,
    formats: Annotated[
        list[str] | None, typer.Option("--format", help="More files: gpkg, shapefile, coco. Repeatable.")
    ] = None,
    device: Device = None,
    seed: Seed = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Match the polygons of two photographs.

    Writes matches.json, left.geojson, right.geojson and overlay.png; for georeferenced photographs matches.gpkg, for
    large ones contact.png. A large run that is interrupted goes on where it was when it is started again.
    """
    if segmenter not in (None, *SEGMENTERS):
        raise ConfigError(f"unknown segmenter '{segmenter}'; segmenters are: {', '.join(SEGMENTERS)}")
    check_method(method)
    model = None if segmenter == "precomputed" else segmenter
    options = {
        "segment.model": model,
        "segment.quality": quality,
        "points.methods": points,
        "tiles.mode": tiles,
        "raster.bands": bands,
        "raster.gsd": gsd,
        "raster.min_area_m2": min_area_m2,
        "device": device,
        "seed": seed,
    }
    config = configure(preset, config_file, settings, options)
    formats = _formats(formats)
    own = _own_regions(segmenter, left_regions, right_regions, config)
    use_weights(weights_dir)
    with fresh_folder(out, left, right), bars(quiet or as_json) as (progress, say):
        kept = out / "tiles"
        more = {"kept": kept} if method == "zpm2" else {}
        matcher = open_method(method, config, segmenter=own, progress=progress, say=say, **more)
        result = matcher(left, right)
        result = result.flatten() if non_overlapping else result
        result = result.with_outlines() if outlines else result
        result.save(out, formats)
        shutil.rmtree(kept, ignore_errors=True)
    _report(result, out, quiet, as_json)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")] = Path("zpm2-demo"),
    preset: Preset = "default",
    settings: Settings = None,
    device: Device = None,
    seed: Seed = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Render a stereo pair, match it with the real models, and score the matches against the exact truth."""
    from PIL import Image

    from zpm2.demo import render_scene, score
    from zpm2.io.files import output_folder
    from zpm2.tiled import TiledMatcher

    config = configure(preset, None, settings, {"device": device, "seed": seed})
    use_weights(weights_dir)
    folder = output_folder(out)
    with bars(quiet or as_json) as (progress, say):
        progress("render", 0.0)
        scene = render_scene(config.seed)
        for name, pixels in (("left", scene.left), ("right", scene.right)):
            Image.fromarray(pixels).save(folder / f"{name}.png")
        progress("render", 1.0)
        matcher = TiledMatcher(config, progress=progress, say=say)
        result = matcher(folder / "left.png", folder / "right.png")
        result.save(folder)
    truth = score(result.left.polygons, result.right.polygons, result.matches, scene.disparity)
    _report(result, folder, quiet, as_json, {"good": truth.good, "scored": truth.scored, "coverage": truth.coverage})
    if not (quiet or as_json):
        print(
            f"Against the exact depth: {truth.good} of {truth.scored} matches right (IoU >= 0.5), "
            f"{truth.coverage:.0%} of the area that both cameras see is covered."
        )
        print(f"Open {folder / 'overlay.png'}, then try your own pair: zpm2 match left.png right.png -o out")


@app.command()
def doctor(as_json: AsJson = False, weights_dir: WeightsDir = None) -> None:
    """Versions, devices, cache and weights: what to send along with a question."""
    from zpm2.doctor import examine

    use_weights(weights_dir)
    findings = examine()
    if as_json:
        print(json.dumps(findings, indent=1))
        return
    for section, values in findings.items():
        print(section)
        for name, value in values.items():
            print(f"  {name:<24} {value}")


def _formats(names: list[str] | None) -> list[str]:
    """The file formats asked for, checked before the work begins."""
    from zpm2.io.gis import require_pyogrio
    from zpm2.result import FORMATS

    for name in names or []:
        if name not in FORMATS:
            raise ConfigError(f"unknown format '{name}'; formats are: {', '.join(FORMATS)}")
        if name != "coco":
            require_pyogrio()
    return names or []


def _own_regions(
    segmenter: str | None, left: Path | None, right: Path | None, config: "Config"
) -> "tuple[Segmenter, Segmenter] | None":
    if segmenter != "precomputed" and left is None and right is None:
        return None
    if segmenter not in (None, "precomputed") or left is None or right is None:
        raise ConfigError("own regions need all of: --segmenter precomputed --left-regions FILE --right-regions FILE")
    from zpm2.detect.precomputed import PrecomputedSegmenter

    sides = [PrecomputedSegmenter(path, config.vectorize, config.segment.min_area) for path in (left, right)]
    return sides[0], sides[1]


def _report(result: "MatchResult", out: Path, quiet: bool, as_json: bool, more: dict[str, Any] | None = None) -> None:
    for warning in result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    stages = {stage: sum(m.stage == stage for m in result.matches) for stage in ("global", "local", "guided")}
    summary = {
        "matches": len(result.matches),
        "by_stage": {stage: count for stage, count in stages.items() if count},
        "mean_confidence": round(sum(m.confidence for m in result.matches) / max(len(result.matches), 1), 4),
        "left_polygons": len(result.left.polygons),
        "right_polygons": len(result.right.polygons),
        "points": len(result.points),
        "unmatched": {
            side: dict(Counter(reasons.values()).most_common())
            for side, reasons in (("left", result.left.unmatched), ("right", result.right.unmatched))
        },
        "seconds": {stage: round(seconds, 2) for stage, seconds in result.timings.items()},
        "warnings": list(result.warnings),
        "out": str(out),
        **(more or {}),
    }
    if as_json:
        print(json.dumps(summary))
    elif not quiet:
        _print_table(result, summary, out)


def _print_table(result: "MatchResult", summary: dict[str, Any], out: Path) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column("stage")
    table.add_column("seconds", justify="right")
    table.add_column("result")
    by_stage = ", ".join(f"{count} {stage}" for stage, count in summary["by_stage"].items()) or "none"
    found = {
        "read": f"{result.left.width} x {result.left.height} and {result.right.width} x {result.right.height} px",
        "detect": f"{len(result.left.polygons)} and {len(result.right.polygons)} polygons",
        "points": f"{len(result.points)} homologous points",
        "match" if "match" in result.timings else "local": (
            f"{len(result.matches)} matches ({by_stage}), mean confidence {summary['mean_confidence']:.2f}"
        ),
    }
    for stage, seconds in result.timings.items():
        table.add_row(stage, f"{seconds:.2f}", found.get(stage, ""))
    table.add_row("total", f"{sum(result.timings.values()):.2f}", f"in {out}")
    console = Console()
    console.print(table)
    for side, counts in summary["unmatched"].items():
        if counts:
            console.print(f"{side} without a partner: {', '.join(f'{n} {why}' for why, n in counts.items())}")
