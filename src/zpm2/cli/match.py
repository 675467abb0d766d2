"""`zpm2 match`: the polygons of two photographs, matched."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.engines import Address, EngineName, Gpus, check_engine, open_engine
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
    MaskRegions,
    Masks,
    MaxMemory,
    Method,
    NonOverlapping,
    Out,
    Points,
    Preset,
    Quiet,
    Report,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    check_formats,
    check_masks,
    choices,
    configure,
    known_formats,
    one_of,
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
            metavar="FORMAT",
            help="Also write this format: coco, geojson, geoparquet, gpkg, shapefile, cvat, labelme or "
            "yolo. Repeatable.",
            rich_help_panel=RESULT,
            autocompletion=one_of(known_formats),
        ),
    ] = None,
    non_overlapping: NonOverlapping = False,
    outlines: Annotated[
        bool,
        typer.Option(
            "--outlines",
            help="Add homologous points all around the outlines of each match to matches.json.",
            rich_help_panel=RESULT,
        ),
    ] = False,
    masks: Masks = None,
    mask_regions: MaskRegions = None,
    page: Report = True,
    preset: Preset = "default",
    quality: Annotated[
        str | None,
        typer.Option(
            help="How densely to look for regions: fast, balanced or full.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(choices("segment.quality")),
        ),
    ] = None,
    detail: Annotated[
        str | None,
        typer.Option(
            help="Look again, closer, for smaller regions: off, auto (where little is matched) or high.  "
            "[default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(choices("segment.detail.level")),
        ),
    ] = None,
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="What finds the regions: mobile_sam, sam2_tiny, vit_b, vit_l, vit_h, classical (no weights), "
            "precomputed (your own), another one (zpm2 models), or package.module:Class.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(segmenters),
        ),
    ] = None,
    points: Points = None,
    method: Method = "zpm2",
    config_file: ConfigFile = None,
    settings: Settings = None,
    left_regions: Annotated[
        Path | None,
        typer.Option(
            help="Regions of the left photograph: label image, COCO, GeoJSON, GeoPackage, shapefile, Labelme, CVAT or "
            "YOLO.",
            rich_help_panel=REGIONS,
        ),
    ] = None,
    right_regions: Annotated[
        Path | None, typer.Option(help="The same of the right photograph.", rich_help_panel=REGIONS)
    ] = None,
    tiles: Annotated[
        str | None,
        typer.Option(
            help="Match tile by tile: auto (large photographs only), on or off.  [default: preset's]",
            rich_help_panel=LARGE,
            autocompletion=one_of(choices("tiles.mode")),
        ),
    ] = None,
    bands: Bands = None,
    allowed: AllowVrt = None,
    gsd: Annotated[
        str | None,
        typer.Option(
            help="Ground sample distance, metres per pixel: one number, or left,right.  [default: as the files say]",
            rich_help_panel=LARGE,
        ),
    ] = None,
    min_area_m2: Annotated[
        float | None,
        typer.Option(
            "--min-area-m2", help="Leave out polygons that cover fewer square metres of ground.", rich_help_panel=LARGE
        ),
    ] = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes that make the tiles of a large pair.", rich_help_panel=LARGE)
    ] = 1,
    engine: EngineName = "local",
    address: Address = None,
    gpus: Gpus = 0.0,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Match the polygons of two photographs.

    Writes matches.json, report.html (open it in a browser, or zpm2 view), left.geojson, right.geojson, overlay.png and
    unmatched.png; matches.gpkg for georeferenced photographs; contact.png for large ones; with --masks, masks of the
    matched regions. If a run over large photographs was interrupted, start the same command again: it continues where
    it stopped.
    """
    from zpm2 import api
    from zpm2.files.record import TILES, remove_made, remove_own
    from zpm2.formats.masks import FOLDER, RegionMask, write_masks
    from zpm2.formats.regions.region import split_layer
    from zpm2.formats.saving import DOCUMENT, file_names

    config = configure(preset, config_file, settings, max_memory=max_memory)
    check_formats(formats or [])
    keep = check_masks(masks or [], mask_regions, [left, right])
    use_weights(weights_dir)
    allow_vrt(allowed)
    check_engine(engine, address, gpus)
    regions = [path and split_layer(path)[0] for path in (left_regions, right_regions)]
    inputs = left, right, *regions
    names = [*file_names(formats or []), *([FOLDER] if masks else [])]
    folder = fresh_folder(out, *inputs, names=names, kept=TILES)
    with folder, bars(quiet or as_json) as (progress, say):
        spread = None
        if workers > 1 or engine != "local":
            from zpm2.batch import TileEngine

            spread = TileEngine(open_engine(engine, workers, address, gpus))
        result = api.match(
            left,
            right,
            config,
            segmenter=segmenter,
            quality=quality,
            detail=detail,
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
            workers=spread,
            progress=progress,
            say=say,
        )
        if masks:
            for name in (DOCUMENT, FOLDER):  # of an earlier run
                remove_made(out, name)
            sides = zip((result.left, result.right), result.matched_polygons(), strict=True)
            inside = [RegionMask(side, [polygon.shape for polygon in matched]) for side, matched in sides]
            told = write_masks(out / FOLDER, masks, inside, keep)
            result = replace(result, warnings=[*result.warnings, *told])
        result.save(out, formats or [], report=page)
        if not masks:
            remove_made(out, FOLDER)
        remove_own(out / TILES)
    report(result, out, quiet, as_json)


class Summary(TypedDict):
    """What `--json` prints of a result."""

    matches: int
    by_stage: dict[str, int]
    mean_confidence: float
    left_polygons: int
    right_polygons: int
    points: int
    unmatched: dict[str, dict[str, int]]  # side -> reason -> polygons
    seconds: dict[str, float]  # by stage
    warnings: list[str]
    notes: list[str]
    out: str


def report(
    result: "MatchResult", out: Path, quiet: bool, as_json: bool, more: Mapping[str, object] | None = None
) -> None:
    """Prints the warnings of a result, and what it holds: as JSON, with `more` beside it, or as a table."""
    warn(result.warnings)
    stages = {stage: sum(m.stage == stage for m in result.matches) for stage in ("global", "local", "guided")}
    summary: Summary = {
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
    }
    if as_json:
        print(json.dumps({**summary, **(more or {})}))
    elif not quiet:
        _print_table(result, summary, out)


def _print_table(result: "MatchResult", summary: Summary, out: Path) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column("stage")
    table.add_column("seconds", justify="right")
    table.add_column("result", overflow="fold")
    by_stage = ", ".join(f"{count} {stage}" for stage, count in summary["by_stage"].items()) or "none"
    found = {
        "read": f"{result.left.width} x {result.left.height} and {result.right.width} x {result.right.height} px",
        "detect": f"{len(result.left.polygons)} and {len(result.right.polygons)} polygons",
        "points": f"{len(result.points)} homologous points",
        next((stage for stage in ("match", "local") if stage in result.timings), list(result.timings)[-1]): (
            f"{len(result.matches)} matches ({by_stage}), mean confidence {summary['mean_confidence']:.2f}"
        ),
    }
    for stage, seconds in result.timings.items():
        table.add_row(stage, f"{seconds:.2f}", found.get(stage, ""))
    table.add_row("total", f"{sum(result.timings.values()):.2f}", Text(f"in {out}"))
    Console().print(table)
    for side, counts in summary["unmatched"].items():
        if counts:
            print(f"{side} without a partner: {', '.join(f'{n} {why}' for why, n in counts.items())}")
