"""`zpm2 batch`: thousands of pairs."""

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, warn
from zpm2.cli.engines import Address, EngineName, Gpus, Workers, check_engine, open_engine
from zpm2.cli.options import (
    CAMERAS,
    METHOD,
    REGIONS,
    RESULT,
    RUN,
    AllowVrt,
    AsJson,
    Bands,
    ConfigFile,
    Device,
    MaxMemory,
    Points,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    allow_vrt,
    check_formats,
    configure,
    known_formats,
    one_of,
    registered_segmenters,
    use_weights,
)
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.batch import BatchSummary
    from zpm2.batch.entries import Entry

WAYS = ("auto", "sequential", "exhaustive", "exif-gps", "colmap")
COMMANDS = ("match", "pose", "carry", "tracks")


def batch(
    pairs: Annotated[
        str,
        typer.Argument(
            metavar="PAIRS",
            help="A list (.csv or .parquet with columns left and right), or a folder of photographs. For tracks: with "
            "columns group and photograph, or a folder of folders.",
        ),
    ],
    out: Annotated[
        str, typer.Option("--out", "-o", help="Folder for the results, or an address.", rich_help_panel=RESULT)
    ] = "zpm2-batch",
    command: Annotated[
        str,
        typer.Option(
            help="What is done with each pair: match, pose, carry, or package.module:Class; with each group of "
            "photographs: tracks.",
            rich_help_panel=METHOD,
            autocompletion=one_of(lambda: COMMANDS),
        ),
    ] = "match",
    way: Annotated[
        str,
        typer.Option(
            "--pairs",
            metavar="WAY",
            help="Of a folder, or of each group, which photographs make pairs: auto, sequential, exhaustive, exif-gps, "
            "colmap; of a folder also a file (as of zpm2 tracks).",
            rich_help_panel=METHOD,
            autocompletion=one_of(lambda: WAYS),
        ),
    ] = "auto",
    list_only: Annotated[
        bool, typer.Option("--list-only", help="Of a folder, only write the list.", rich_help_panel=RUN)
    ] = False,
    workers: Workers = 1,
    shard: Annotated[
        str | None,
        typer.Option(metavar="I/N", help="Do only the I-th of N parts of the list.", rich_help_panel=RUN),
    ] = None,
    merge: Annotated[
        bool, typer.Option("--merge", help="Match nothing; write the index of what there is.", rich_help_panel=RUN)
    ] = False,
    engine: EngineName = "local",
    address: Address = None,
    gpus: Gpus = 0.0,
    retries: Annotated[
        int,
        typer.Option(
            min=0, help="How often a pair is tried again whose process died or lacked memory.", rich_help_panel=RUN
        ),
    ] = 2,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="match, pose: also write this format: coco, geojson, geoparquet, gpkg, shapefile, cvat, labelme or "
            "yolo. Repeatable.",
            rich_help_panel=RESULT,
            autocompletion=one_of(known_formats),
        ),
    ] = None,
    page: Annotated[
        bool, typer.Option("--report/--no-report", help="Write report.html of each result.", rich_help_panel=RESULT)
    ] = False,
    pictures: Annotated[
        bool,
        typer.Option(
            "--pictures/--no-pictures",
            help="match, pose: write overlay.png and unmatched.png, most of the bytes of a pair; tracks: sheets.",
            rich_help_panel=RESULT,
        ),
    ] = False,
    regions: Annotated[
        str | None,
        typer.Option(help="carry: regions of all left photographs.  [default: of the list]", rich_help_panel=REGIONS),
    ] = None,
    rigid: Annotated[
        bool, typer.Option("--rigid", help="carry: only move the outlines.", rich_help_panel=REGIONS)
    ] = False,
    k: Annotated[
        str | None,
        typer.Option("--K", help="pose: left cameras, as of zpm2 pose.  [default: column K]", rich_help_panel=CAMERAS),
    ] = None,
    k2: Annotated[
        str | None, typer.Option("--K2", help="pose: right cameras.  [default: column K2]", rich_help_panel=CAMERAS)
    ] = None,
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
    """Do many pairs or groups of photographs, with one index.

    Each pair is matched, or its pose is found, or regions are carried; through each group, regions are followed. Each
    has a folder of its own in pairs/ (a group in groups/), with the files of that command; index.parquet has a row for
    each, and grows while the run goes on. Start the same command again to go on after an interruption. If a pair
    failed, its row says why, the others are done, and the exit code is 1.
    """
    from zpm2 import batch as batches

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
    check_formats(formats or [])
    use_weights(weights_dir)
    allow_vrt(allowed)
    check_engine(engine, address, gpus)
    regions = None if regions is None else os.path.abspath(regions)
    job = batches.Job(out, command, config, tuple(formats or ()), page, pictures, regions, rigid, k, k2, way=way)
    job.check()
    if merge and shard is not None:
        raise ConfigError("--merge is of all shards: leave out --shard")
    if way != "auto" and job.kind == "pair" and not os.path.isdir(pairs):
        raise ConfigError(f"--pairs {way} is for a folder of photographs, and {pairs} is none: leave it out")
    with bars(quiet or as_json) as (progress, say):
        listed: Sequence[Entry]
        if job.kind == "group":
            listed = batches.groups_of_folder(pairs) if os.path.isdir(pairs) else batches.read_groups(pairs)
        elif os.path.isdir(pairs):
            listed, warnings = batches.pairs_of_folder(pairs, way, config, progress)
            warn(warnings)
        else:
            listed = batches.read_pairs(pairs)
        if list_only:
            place = batches.save_list(listed, out)
            print(f"{len(listed)} {job.kind}s in {place}")
            return
        if merge:
            found = batches.merge(listed, job)
        else:
            hands = open_engine(engine, workers, address, gpus)
            try:
                found = batches.run(listed, job, engine=hands, shard=shard, retries=retries, progress=progress, say=say)
            except KeyboardInterrupt as stop:
                stop.add_note(f"what is finished is kept in {out}: run the same command again to go on")
                raise
    _report(found, job.kind, quiet, as_json, told=not (quiet or as_json or merge))
    if found.failed:
        raise typer.Exit(1)


def _report(found: "BatchSummary", kind: str, quiet: bool, as_json: bool, told: bool) -> None:
    """Prints what became of a list; warns of what failed unless that was `told` as it came."""
    what, failures = f"{kind}s", {} if told or not found.failed else _failures(found.index, kind)
    warn(f"{name}: {reason}" for name, reason in failures.items())
    if as_json:
        values: dict[str, object] = {
            what: found.pairs,
            "done": found.done,
            "reused": found.reused,
            "failed": found.failed,
        }
        values |= {"failures": failures, "missing": found.missing, "complete": found.complete}
        print(json.dumps({**values, "seconds": round(found.seconds, 2), "index": found.index}))
    elif not quiet:
        missing = f", {found.missing} not done yet" if found.missing else ""
        print(
            f"{found.done} of {found.pairs} {what} done ({found.reused} of an earlier run), {found.failed} failed"
            f"{missing}; {found.seconds:.1f} s"
        )
        print(f"Index: {found.index}" + ("" if found.complete else ", of this shard; others are not complete yet"))


def _failures(index: str, kind: str) -> dict[str, str]:
    """Why the rows of an index failed that did, by name."""
    from zpm2.batch import read_index

    return {str(row[kind]): str(row["reason"]) for row in read_index(index) if row["status"] == "failed"}
