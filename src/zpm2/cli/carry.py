"""`zpm2 carry`: regions of one photograph in others."""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import (
    METHOD,
    REGIONS,
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
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.carry import CarryResult


def carry(
    left: Annotated[Path, typer.Argument(help="Photograph that the regions are given on.")],
    rights: Annotated[list[Path], typer.Argument(metavar="RIGHT...", help="Photographs to find them in.")],
    regions: Annotated[
        Path,
        typer.Option(
            help="Regions of the left photograph: label image, COCO, Labelme, CVAT, YOLO, GeoJSON, GeoPackage or "
            "shapefile (docs/own-regions.md).",
            rich_help_panel=REGIONS,
        ),
    ],
    out: Out = Path("zpm2-carry"),
    masks: Masks = None,
    mask_regions: MaskRegions = None,
    rigid: Annotated[
        bool,
        typer.Option(
            "--rigid", help="Only move the given outlines, and keep their form; no segmenter.", rich_help_panel=METHOD
        ),
    ] = False,
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="What finds the outlines: mobile_sam or another one that takes prompts.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(registered_segmenters),
        ),
    ] = None,
    points: Points = None,
    page: Report = True,
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
    """Find given regions of one photograph in others.

    For each right photograph a folder of its name gets the regions in the format they came in, with the same ids,
    labels and attributes, carry.json with status, confidence and reason of each, report.html (open it in a browser, or
    zpm2 view) and overlay.png; of georeferenced photographs also the shift of each region. With --masks, a folder masks
    has those of all photographs.
    """
    from zpm2 import api
    from zpm2.carry import opened_regions
    from zpm2.files.listing import distinct_stems
    from zpm2.files.record import make_folder, remove_made, temporary_folder
    from zpm2.formats.masks import FOLDER, RegionMask, write_masks
    from zpm2.formats.regions.region import split_layer

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
    file = opened_regions(regions)
    folders = distinct_stems(rights)
    alone = left.absolute() not in [right.absolute() for right in rights]
    keep = check_masks(masks or [], mask_regions, [left, *rights] if alone else rights)
    if masks and FOLDER in folders:
        raise ConfigError(f"--masks needs the folder {FOLDER}, which is that of a right photograph: rename this one")
    with (
        fresh_folder(out, left, *rights, split_layer(regions)[0], names=[*folders, *([FOLDER] if masks else [])]),
        bars(quiet or as_json) as (progress, say),
        temporary_folder(out) if len(rights) > 1 else nullcontext() as aside,
    ):
        matcher = api.Matcher(config, progress=progress, say=say, aside=aside)
        found = []
        for folder, right in zip(folders, rights, strict=True):
            result = matcher.carry(left, right, file, rigid=rigid)
            result.save(make_folder(out / folder), report=page)
            found.append((folder, result))
        if FOLDER not in folders:
            remove_made(out, FOLDER)
        told = list[str]()
        if masks:
            given = found[0][1]
            inside = [RegionMask(given.left, [shape for shape in given.shapes if shape is not None])] if alone else []
            inside += [
                RegionMask(each.right, [o.shape for o in each.outcomes if o.shape is not None]) for _, each in found
            ]
            told = write_masks(out / FOLDER, masks, inside, keep)
    _report(found, out, quiet, as_json, told)


def _report(found: "list[tuple[str, CarryResult]]", out: Path, quiet: bool, as_json: bool, told: list[str]) -> None:
    for _, result in found:
        warn(result.warnings)
    warn(told)
    if as_json:
        summaries = [
            {
                "right": folder,
                "regions": len(result.regions),
                "by_status": result.counts(),
                "seconds": {stage: round(seconds, 2) for stage, seconds in result.timings.items()},
                "warnings": list(result.warnings),
                "notes": list(result.notes),
            }
            for folder, result in found
        ]
        print(json.dumps({"photographs": summaries, "out": str(out), **({"masks": told} if told else {})}))
    elif not quiet:
        for folder, result in found:
            counts = ", ".join(f"{count} {status}" for status, count in result.counts().items())
            print(f"{folder}: {len(result.regions)} regions: {counts}; {sum(result.timings.values()):.1f} s")
        print(f"in {out}")
