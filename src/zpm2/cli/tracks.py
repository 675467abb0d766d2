"""`zpm2 tracks`: regions followed through many photographs."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    METHOD,
    RESULT,
    AllowVrt,
    AsJson,
    Bands,
    ConfigFile,
    Device,
    MaskRegions,
    Masks,
    MaxMemory,
    Out,
    Points,
    Preset,
    Quiet,
    Report,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    check_masks,
    configure,
    one_of,
    registered_segmenters,
    use_weights,
)

if TYPE_CHECKING:
    from zpm2.tracking import TracksResult


def tracks(
    photographs: Annotated[list[Path], typer.Argument(metavar="PHOTOS...", help="Photographs, or a folder of them.")],
    out: Out = Path("zpm2-tracks"),
    pairs: Annotated[
        str,
        typer.Option(
            metavar="WAY",
            help="Which photographs are matched with each other: sequential, exhaustive, exif-gps, colmap (the pairs "
            "of its database.db), a database or model of COLMAP, a list with two names a line, or auto: by position, "
            "else by points.",
            rich_help_panel=METHOD,
            autocompletion=one_of(lambda: ("auto", "sequential", "exhaustive", "exif-gps", "colmap")),
        ),
    ] = "auto",
    sheets: Annotated[
        int, typer.Option(min=0, help="Contact sheets to write, of the longest tracks.", rich_help_panel=RESULT)
    ] = 20,
    page: Report = True,
    masks: Masks = None,
    mask_regions: MaskRegions = None,
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="What finds the regions.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(registered_segmenters),
        ),
    ] = None,
    points: Points = None,
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
    """Follow regions through many photographs.

    Writes tracks.json, a label image of each photograph (labels/) and coco.json, whose numbers are those of the tracks,
    tracks.csv, report.html (open it in a browser, or zpm2 view), and contact sheets of the longest tracks (sheets/);
    with --masks, masks of the regions in all tracks. The next run uses finished pairs again.
    """
    from zpm2.files.record import remove_made
    from zpm2.formats.masks import FOLDER, RegionMask, write_masks
    from zpm2.tracking import tracks as follow
    from zpm2.tracking.matches import KEPT
    from zpm2.tracking.photographs import listed
    from zpm2.tracking.result import file_names

    config = configure(
        preset,
        config_file,
        settings,
        segmenter=segmenter,
        points=points,
        bands=bands,
        device=device,
        seed=seed,
        max_memory=max_memory,
    )
    use_weights(weights_dir)
    allow_vrt(allowed)
    keep = check_masks(masks or [], mask_regions, listed(photographs) if masks else [])
    list_of_pairs = Path(pairs) if os.path.isfile(pairs) else None
    names = [*file_names(), *([FOLDER] if masks else [])]
    with (
        fresh_folder(out, *photographs, list_of_pairs, names=names, kept=KEPT),
        bars(quiet or as_json) as (progress, say),
    ):
        found = follow(photographs, config, pairs=pairs, kept=out / KEPT, progress=progress, say=say)
        found.save(out, sheets, report=page)
        remove_made(out, FOLDER)
        told = list[str]()
        if masks:
            regions = ([polygon.shape for polygon in found.polygons(row)] for row in range(len(found.photographs)))
            inside = [RegionMask(photo, own) for photo, own in zip(found.photographs, regions, strict=True)]
            told = write_masks(out / FOLDER, masks, inside, keep)
    _report(found, out, quiet, as_json, told)
    if not found.tracks:
        raise typer.Exit(1)


def _report(found: "TracksResult", out: Path, quiet: bool, as_json: bool, told: list[str]) -> None:
    warn(found.warnings)
    warn(told)
    if as_json:
        summary = {
            "photographs": len(found.photographs),
            "pairs": len(found.pairs),
            "chosen": found.chosen,
            "tracks": len(found.tracks),
            "by_photographs": found.lengths(),
            "events": len(found.events),
            "seconds": {stage: round(seconds, 2) for stage, seconds in found.timings.items()},
            "warnings": list(found.warnings),
            "notes": list(found.notes),
        }
        print(json.dumps(summary | {"out": str(out), **({"masks": told} if told else {})}))
    elif not quiet:
        longer = sum(count for n, count in found.lengths().items() if n >= 3)
        print(
            f"{len(found.tracks)} tracks in {len(found.photographs)} photographs, {longer} of them in three or more; "
            f"{len(found.pairs)} pairs ({found.chosen}); {sum(found.timings.values()):.1f} s"
        )
        page = " (open report.html, or run zpm2 view)" if (out / "report.html").is_file() else ""
        print(f"Written: {out / 'tracks.json'}, labels, coco.json, tracks.csv, sheets{page}")
