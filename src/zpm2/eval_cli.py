"""`zpm2 eval`: a data set through the method, scored against its ground truth."""

import itertools
import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.config import Config
    from zpm2.evaluate.predictions import Matcher

METHODS = ("zpm2", "shape-context", "idsc")


def evaluate(
    dataset: Annotated[str, typer.Argument(help="pairs, csv, sceneflow, kitti2015, middlebury, scannet1500, ...")],
    root: Annotated[Path, typer.Option(help="The folder that holds the data set, as its publisher lays it out.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for predictions and scores.")],
    split: Annotated[str | None, typer.Option(help="A part of the data set.")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="The first so many pairs.")] = None,
    preset: Annotated[str, typer.Option(help="paper or default.")] = "default",
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="STAGE.FIELD=VALUE", help="Repeatable.")
    ] = None,
    method: Annotated[str, typer.Option(help="zpm2, or a classical baseline: shape-context, idsc.")] = "zpm2",
    score_only: Annotated[bool, typer.Option("--score-only", help="Score the predictions that are there.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write rows.parquet too.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")] = False,
) -> None:
    """Match every pair of a data set and score the matches.

    Predictions are kept, a folder a pair: a run that was interrupted goes on where it stopped, and --score-only scores
    again without any model. Writes rows.csv, summary.json and summary.md.
    """
    from zpm2 import config as configuration
    from zpm2.evaluate import predictions, report
    from zpm2.evaluate.datasets import open_dataset

    if method not in METHODS:
        raise ConfigError(f"unknown method '{method}'; methods are: {', '.join(METHODS)}")
    config = configuration.assign(configuration.preset(preset), settings or [])
    if parquet:
        report.require_parquet()
    pairs = list(itertools.islice(open_dataset(dataset, root, split).pairs(), limit))
    tell = _teller(len(pairs), quiet)
    if not score_only:
        predictions.Run(dataset, split, method, config.to_dict()).claim(out)
        predictions.predict(pairs, lambda: _matcher(method, config), out, lambda text: tell("matched", text))
    tell = _teller(len(pairs), quiet)
    rows = report.collect(pairs, out, lambda text: tell("scored", text))
    made_by = shlex.join(["zpm2", *sys.argv[1:]])
    report.write(f"{dataset}, {method}, preset {preset}", rows, out, made_by, parquet)
    for values in rows:
        if values["status"] != "ok":
            print(f"warning: {values['pair']}: {values['status']}", file=sys.stderr)
    if not quiet:
        total = {name: value for name, value in report.summary(rows).items() if value is not None}
        print(json.dumps(total, indent=1))
        print(f"Written: {out / 'summary.md'}, {out / 'rows.csv'}")


def _matcher(method: str, config: "Config") -> "Matcher":
    if method != "zpm2":
        from zpm2.baselines import BaselineMatcher

        return BaselineMatcher(method, config)
    from zpm2.pipeline import PolygonMatcher

    return PolygonMatcher(config)


def _teller(total: int, quiet: bool) -> Callable[[str, str], None]:
    """Says how far a run has come, a line a pair, on stderr."""
    count = itertools.count(1)

    def tell(what: str, text: str) -> None:
        if not quiet:
            print(f"{what} {next(count)} of {total}: {text}", file=sys.stderr)

    return tell
