"""`zpm2 eval`: a data set through the method, scored against its ground truth."""

import functools
import itertools
import json
import shlex
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from zpm2.api import check_method, open_method
from zpm2.cli.console import (
    AllowVrt,
    Command,
    MaxMemory,
    Method,
    Out,
    Preset,
    Quiet,
    Settings,
    allow_vrt,
    configure,
    fresh_folder,
    one_of,
)
from zpm2.errors import ConfigError, InputError

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.evaluate.pairs import EvalPair
    from zpm2.evaluate.predicted_regions import PredictedRegions
    from zpm2.evaluate.predictions import FindPose, MatchPair
    from zpm2.pose import PoseResult
    from zpm2.result import MatchResult


def datasets() -> Iterable[str]:
    """The names of the data sets."""
    from zpm2.evaluate.datasets import DATASETS

    return DATASETS


class EvalCommand(Command):
    """`zpm2 eval`, whose help names the registered data sets."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """As `Command`; the data sets are looked up now, as their modules take time to load."""
        for item in self.get_params(ctx):
            if item.name == "dataset":
                cast(Any, item).help = f"One of {', '.join(datasets())}; see docs/datasets.md."
        super().format_options(ctx, formatter)


def evaluate(
    dataset: Annotated[str, typer.Argument(help="A data set by name.", autocompletion=one_of(datasets))],
    root: Annotated[Path, typer.Option(help="The folder that holds the data set, as its publisher lays it out.")],
    out: Out = Path("zpm2-eval"),
    split: Annotated[str | None, typer.Option(help="A part of the data set.")] = None,
    option: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Of the data set (docs/datasets.md); repeatable.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="The first so many pairs.")] = None,
    preset: Preset = "default",
    settings: Settings = None,
    method: Method = "zpm2",
    regions: Annotated[
        Path | None, typer.Option(help="Take the polygons of the predictions in this folder instead of detecting them.")
    ] = None,
    score_only: Annotated[bool, typer.Option("--score-only", help="Score the predictions that are there.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write rows.parquet too.")] = False,
    allowed: AllowVrt = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
) -> None:
    """Match every pair of a data set and score the matches.

    Predictions are kept, a folder a pair: a run that was interrupted goes on where it stopped, and --score-only scores
    again without any model. Writes rows.csv, summary.json and summary.md.
    """
    from zpm2.evaluate import predictions, report
    from zpm2.evaluate.datasets import open_dataset
    from zpm2.evaluate.predicted_regions import PredictedRegions

    check_method(method)
    allow_vrt(allowed)
    config = configure(preset, None, settings, {"max_memory": max_memory})
    if parquet:
        report.require_parquet()
    pairs = list(itertools.islice(open_dataset(dataset, root, split, **_options(option or [])).pairs(), limit))
    tell = _teller(len(pairs), quiet)
    if score_only and not (out / "run.json").exists():
        raise InputError(f"{out} holds no predictions: run the same command without --score-only first")
    names = [predictions.RUN, predictions.PREDICTIONS, *report.names(parquet)]
    with fresh_folder(out, names=names, kept=predictions.PREDICTIONS):
        if not score_only:
            kept = PredictedRegions(regions) if regions else None
            source = str(regions.resolve()) if regions else None
            predictions.PredictionSettings(dataset, split, method, config.to_dict(), source).claim(out)
            find_pose = _pose_finder(config) if method == "zpm2" else lambda pair, result: None
            matcher = functools.partial(_matcher, method, config, kept)
            predictions.predict(pairs, matcher, out, functools.partial(tell, "matched"), find_pose, regions)
        tell = _teller(len(pairs), quiet)
        rows = report.collect(pairs, out, lambda text: tell("scored", text))
        made_by = shlex.join(["zpm2", *sys.argv[1:]])
        beside = report.pose_table(rows) if dataset == "scannet1500" else ""
        report.write(f"{dataset}, {method}, preset {preset}", rows, out, made_by, parquet, beside)
    for values in rows:
        if values["status"] != "ok":
            print(f"warning: {values['pair']}: {values['status']}", file=sys.stderr)
    if not quiet:
        total = {name: value for name, value in report.summary(rows).items() if value is not None}
        print(json.dumps(total, indent=1))
        if beside:
            print(beside)
        print(f"Written: {out / 'summary.md'}, {out / 'rows.csv'}")


def _matcher(method: str, config: "Config", kept: "PredictedRegions | None") -> "MatchPair":
    """The method as a function of a pair of a data set."""
    match = open_method(method, config, segmenter=kept.sides if kept else None)

    def of(pair: "EvalPair") -> "MatchResult":
        if kept:
            kept.set_pair(pair)
        return match(pair.left, pair.right)

    return of


def _pose_finder(config: "Config") -> "FindPose":
    """The pose of a pair of which the cameras are known."""
    from zpm2.evaluate.pairs import PoseTruth
    from zpm2.evaluate.report import cameras_of
    from zpm2.pose import PoseFinder
    from zpm2.runtime import resolve_device

    finder = PoseFinder(config, device=resolve_device(config.device))

    def of(pair: "EvalPair", result: "MatchResult") -> "PoseResult | None":
        return finder(result, cameras_of(result, pair.truth)) if isinstance(pair.truth, PoseTruth) else None

    return of


def _options(texts: list[str]) -> dict[str, Any]:
    """Options of a data set as Python values: "true", "false" and whole numbers become what they mean."""
    found: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name and value):
            raise ConfigError(f"--option {text}: expected NAME=VALUE, for example gap=20")
        found[name] = {"true": True, "false": False}.get(value.lower(), int(value) if value.isdecimal() else value)
    return found


def _teller(total: int, quiet: bool) -> Callable[[str, str], None]:
    """Says how far a run has come, a line a pair, on stderr."""
    count = itertools.count(1)

    def tell(what: str, text: str) -> None:
        if not quiet:
            print(f"{what} {next(count)} of {total}: {text}", file=sys.stderr)

    return tell
