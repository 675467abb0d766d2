"""The command line: `zpm2 demo`, `match`, `pose`, `reconstruct`, `cloud`, `eval`, `config`, `weights`, `doctor`."""

import errno
import json
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from zpm2._version import __version__
from zpm2.api import check_method, finished, open_method, own_regions
from zpm2.cli.cloud import cloud
from zpm2.cli.config import app as config_app
from zpm2.cli.console import (
    LARGE,
    METHOD,
    REGIONS,
    RESULT,
    AllowVrt,
    AsJson,
    Bands,
    Command,
    ConfigFile,
    Device,
    Interrupted,
    MaxMemory,
    Method,
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
    known_formats,
    one_of,
    point_methods,
    terminable,
    use_weights,
)
from zpm2.cli.eval import evaluate
from zpm2.cli.pose import pose
from zpm2.cli.reconstruct import reconstruct
from zpm2.cli.weights import app as weights_app
from zpm2.errors import ConfigError, Zpm2Error

if TYPE_CHECKING:
    from zpm2.result import MatchResult

ORDER = ("demo", "match", "pose", "reconstruct", "cloud", "eval", "config", "weights", "doctor")


class Commands(TyperGroup):
    """The commands in the order of use."""

    def list_commands(self, ctx: Any) -> list[str]:
        return sorted(self.commands, key=ORDER.index)

    def invoke(self, ctx: Any) -> Any:
        """As typer does, which would swallow an interrupt with all that is said about it."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise Interrupted(stop) from stop


app = typer.Typer(
    cls=Commands,
    help="Match polygons between two overlapping photographs.",
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"max_content_width": 1000},  # as wide as the terminal
)
app.add_typer(config_app, name="config")
app.add_typer(weights_app, name="weights")
for name, command in (("eval", evaluate), ("pose", pose), ("cloud", cloud), ("reconstruct", reconstruct)):
    app.command(name, cls=Command)(command)

# Base of typer's usage errors: click's class, or that of the click which newer typers carry inside.
UsageError: Any = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")

SEGMENTERS = (*choices("segment.model")(), "precomputed")


def main() -> None:
    """Entry point. Misuse prints one line and exits with 2; an interrupt says what stays and exits with 130."""
    try:
        _no_empty_values(sys.argv[1:])
        with terminable():
            status = app(prog_name="zpm2", standalone_mode=False)
    except Zpm2Error as error:
        sys.exit(_complain(str(error)))
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        name = str(error.filename)
        sys.exit(_complain(f"a name of {len(name)} letters is too long for a file: {name[:40]}...; give a shorter one"))
    except UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message(), file=sys.stderr)
            sys.exit(2)
        command = error.ctx.command_path if getattr(error, "ctx", None) else "zpm2"
        sys.exit(_complain(f"{error.format_message().rstrip('.')}; see {command} --help"))
    except (Interrupted, typer.Abort, KeyboardInterrupt) as stop:
        _complain(str(stop) or "interrupted")
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def _no_empty_values(words: list[str]) -> None:
    """An empty word, of a variable that is not set, for instance, would be taken for the folder that we are in."""
    for before, word in zip(["the first argument", *words], words, strict=False):
        if not word or (word.startswith("--") and word.endswith("=")):
            raise ConfigError(f"{word.rstrip('=') or f'what follows {before}'} is empty: give a value")


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


@app.command("match", cls=Command)
def match_command(
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    out: Out = Path("zpm2-match"),
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help="More files: gpkg, shapefile, coco, ... (a wrong name lists all). Repeatable.",
            rich_help_panel=RESULT,
            autocompletion=one_of(known_formats),
        ),
    ] = None,
    non_overlapping: Annotated[
        bool,
        typer.Option("--non-overlapping", help="Give each pixel to one match at most.", rich_help_panel=RESULT),
    ] = False,
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
            help="fast, balanced or full: how many of the prompts are asked.  [default: preset's]",
            rich_help_panel=METHOD,
            autocompletion=one_of(choices("segment.quality")),
        ),
    ] = None,
    segmenter: Annotated[
        str | None,
        typer.Option(
            help="mobile_sam, vit_b, vit_l, vit_h, or precomputed (your own regions).",
            rich_help_panel=METHOD,
            autocompletion=one_of(lambda: SEGMENTERS),
        ),
    ] = None,
    points: Annotated[
        str | None,
        typer.Option(
            help="Point matchers, comma separated: xfeat,sift.",
            rich_help_panel=METHOD,
            autocompletion=one_of(point_methods),
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
            help="auto, on or off: large photographs tile by tile.  [default: preset's]",
            rich_help_panel=LARGE,
            autocompletion=one_of(choices("tiles.mode")),
        ),
    ] = None,
    bands: Bands = None,
    allowed: AllowVrt = None,
    gsd: Annotated[
        str | None,
        typer.Option(
            help="m on the ground per px, one or left,right.  [default: as the files say]", rich_help_panel=LARGE
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
    matches.gpkg, for large ones contact.png. A large run that is interrupted goes on where it was when it is started
    again.
    """
    if segmenter not in (None, *SEGMENTERS):
        raise ConfigError(f"unknown segmenter '{segmenter}'; segmenters are: {', '.join(SEGMENTERS)}")
    check_method(method)
    from zpm2.files.record import TILES, remove_own
    from zpm2.formats import registry
    from zpm2.formats.saving import file_names

    options = {
        "segmenter": None if segmenter == "precomputed" else segmenter,
        "quality": quality,
        "points": points,
        "tiles": tiles,
        "bands": bands,
        "gsd": gsd,
        "min_area_m2": min_area_m2,
        "device": device,
        "seed": seed,
        "max_memory": max_memory,
    }
    config = configure(preset, config_file, settings, options)
    formats = formats or []
    registry.chosen(formats)  # checked before the work begins
    own = own_regions(segmenter, left_regions, right_regions, config)
    use_weights(weights_dir)
    allow_vrt(allowed)
    inputs = left, right, left_regions, right_regions
    folder = fresh_folder(out, *inputs, names=file_names(formats), kept=TILES)
    with folder, bars(quiet or as_json) as (progress, say):
        more = {"kept": out / TILES} if method == "zpm2" else {}
        matcher = open_method(method, config, segmenter=own, progress=progress, say=say, **more)
        result = finished(matcher(left, right), non_overlapping, outlines)
        result.save(out, formats)
        remove_own(out / TILES)
    _report(result, out, quiet, as_json)


@app.command(cls=Command)
def demo(
    out: Out = Path("zpm2-demo"),
    preset: Preset = "default",
    settings: Settings = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Render a stereo pair, match it with the real models, and score the matches against the exact truth.

    Writes the files of zpm2 match beside left.png and right.png, and the true regions of both as label images,
    left_labels.png and right_labels.png, to try --left-regions and --right-regions with.
    """
    import cv2

    from zpm2.api import Matcher
    from zpm2.evaluate.rendered import render_scene, score
    from zpm2.files.writing import atomic_write
    from zpm2.formats.saving import file_names

    config = configure(preset, None, settings, {"device": device, "seed": seed, "max_memory": max_memory})
    use_weights(weights_dir)
    names = "left.png", "right.png", "left_labels.png", "right_labels.png"
    with fresh_folder(out, names=[*names, *file_names()]), bars(quiet or as_json) as (progress, say):
        progress("render", 0.0)
        scene = render_scene(config.seed)
        photographs = [cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) for pixels in (scene.left, scene.right)]
        for name, pixels in zip(names, (*photographs, scene.labels, scene.labels_right), strict=True):
            atomic_write(out / name, cv2.imencode(".png", pixels)[1].tobytes())
        progress("render", 1.0)
        matcher = Matcher(config, progress=progress, say=say)
        result = matcher(out / names[0], out / names[1])
        result.save(out)
    truth = score(result.left.polygons, result.right.polygons, result.matches, scene.disparity)
    _report(result, out, quiet, as_json, {"good": truth.good, "scored": truth.scored, "coverage": truth.coverage})
    if not (quiet or as_json):
        print(
            f"Against the exact depth: {truth.good} of {truth.scored} matches right (IoU >= 0.5), "
            f"{truth.coverage:.0%} of the area that both cameras see is covered."
        )
        print(f"Open {out / 'overlay.png'}, then try your own pair: zpm2 match left.png right.png -o out")


@app.command(cls=Command)
def doctor(as_json: AsJson = False, weights_dir: WeightsDir = None) -> None:
    """Versions, devices, cache and weights: what to send along with a question."""
    from zpm2.cli.doctor import examine

    use_weights(weights_dir)
    findings = examine()
    if as_json:
        print(json.dumps(findings, indent=1))
        return
    for section, values in findings.items():
        print(section)
        for name, value in values.items():
            print(f"  {name:<24} {value}")


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
