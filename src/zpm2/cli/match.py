"""`zpm2 match`: the polygons of two photographs, matched."""

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    LARGE,
    METHOD,
    REGIONS,
    RESULT,
    AllowVrt,
    AsJson,
    Bands,
    ConfigFile,
    Device,
    MaxMemory,
    Method,
    NonOverlapping,
    Out,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    check_formats,
    choices,
    configure,
    known_formats,
    one_of,
    point_matchers,
    segmenters,
    use_weights,
)

if TYPE_CHECKING:
    from zpm2.result import MatchResult


def match(
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    out: Out = Path("zpm2-match"),
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help="More files: coco, geojson, gpkg, shapefile. Repeatable.",
            rich_help_panel=RESULT,
            autocompletion=one_of(known_formats),
        ),
    ] = None,
    non_overlapping: NonOverlapping = False,
    outlines: Annotated[
        bool,
        typer.Option(
            "--outlines",
            help="Pair the outlines of each match, point by point, in matches.json.",
            rich_help_panel=RESULT,
        ),
    ] = False,
    preset: Preset = "default",
    quality: Annotated[
        str | None,
        typer.Option(
            help="fast, balanced or full: how densely regions are looked for.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(choices("segment.quality")),
        ),
    ] = None,
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="mobile_sam, vit_b, vit_l, vit_h, precomputed (your own regions), another that is installed, or "
            "package.module:Class.",
            rich_help_panel=METHOD,
            autocompletion=one_of(segmenters),
        ),
    ] = None,
    points: Annotated[
        str | None,
        typer.Option(
            help="Point matchers, comma separated: xfeat,sift; also package.module:Class.",
            rich_help_panel=METHOD,
            autocompletion=one_of(point_matchers),
        ),
    ] = None,
    method: Method = "zpm2",
    config_file: ConfigFile = None,
    settings: Settings = None,
    left_regions: Annotated[
        Path | None, typer.Option(help="Label image, COCO JSON or GeoJSON, left.", rich_help_panel=REGIONS)
    ] = None,
    right_regions: Annotated[Path | None, typer.Option(help="The same, right.", rich_help_panel=REGIONS)] = None,
    tiles: Annotated[
        str | None,
        typer.Option(
            help="auto, on or off: match large photographs tile by tile.  [default: preset's]",
            rich_help_panel=LARGE,
            autocompletion=one_of(choices("tiles.mode")),
        ),
    ] = None,
    bands: Bands = None,
    allowed: AllowVrt = None,
    gsd: Annotated[
        str | None,
        typer.Option(
            help="Ground sampling distance, m per px, one or left,right.  [default: as the files say]",
            rich_help_panel=LARGE,
        ),
    ] = None,
    min_area_m2: Annotated[
        float | None,
        typer.Option(
            "--min-area-m2", help="Leave out polygons smaller than this on the ground.", rich_help_panel=LARGE
        ),
    ] = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Match the polygons of two photographs.

    Writes matches.json, left.geojson, right.geojson, overlay.png and unmatched.png; for georeferenced photographs
    matches.gpkg, for large ones contact.png. A large run that was interrupted goes on from where it stopped when the
    same command is started again.
    """
    from zpm2 import api
    from zpm2.files.record import TILES, remove_own
    from zpm2.formats.saving import file_names

    config = configure(preset, config_file, settings, max_memory=max_memory)
    check_formats(formats or [])
    use_weights(weights_dir)
    allow_vrt(allowed)
    inputs = left, right, left_regions, right_regions
    folder = fresh_folder(out, *inputs, names=file_names(formats or []), kept=TILES)
    with folder, bars(quiet or as_json) as (progress, say):
        result = api.match(
            left,
            right,
            config,
            segmenter=segmenter,
            quality=quality,
            left_regions=left_regions,
            right_regions=right_regions,
            method=method,
            points=points,
            non_overlapping=non_overlapping,
            outlines=outlines,
            tiles=tiles,
            bands=bands,
            gsd=gsd,
            min_area_m2=min_area_m2,
            device=device,
            seed=seed,
            kept=out / TILES,
            progress=progress,
            say=say,
        )
        result.save(out, formats or [])
        remove_own(out / TILES)
    report(result, out, quiet, as_json)


def report(result: "MatchResult", out: Path, quiet: bool, as_json: bool, more: dict[str, Any] | None = None) -> None:
    """Prints the warnings of a result, and what it holds: as JSON, with `more` beside it, or as a table."""
    warn(result.warnings)
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
        "notes": list(result.notes),
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
