"""`zpm2 eval`: a data set through the method, scored against its ground truth."""

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from zpm2.cli.console import fresh_folder, warn
from zpm2.cli.options import (
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
    datasets,
    one_of,
)
from zpm2.errors import ConfigError


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
    results: Annotated[
        tuple[str, Path] | None,
        typer.Option(
            "--results",
            metavar="FORMAT FOLDER",
            help="Score another tool's area matches instead (docs/peers.md): areas, masa or sam2, and their folder.",
        ),
    ] = None,
    table: Annotated[
        int | None,
        typer.Option(
            "--table", min=1, max=6, help="A table of the paper: every row that can be run, beside the published ones."
        ),
    ] = None,
    score_only: Annotated[bool, typer.Option("--score-only", help="Score the predictions that are there.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write rows.parquet too.")] = False,
    allowed: AllowVrt = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
) -> None:
    """Match every pair of a data set and score the matches, or those that another tool wrote.

    Predictions are kept, a folder for each pair: a run that was interrupted goes on where it stopped, and --score-only
    scores them again without any model. Writes rows.csv, summary.json and summary.md.
    """
    from zpm2.evaluate import report
    from zpm2.evaluate.predictions import PREDICTIONS
    from zpm2.evaluate.run import Evaluation, file_names

    allow_vrt(allowed)
    config = configure(preset, None, settings, max_memory=max_memory)
    evaluation = Evaluation(dataset, root, split, _options(option or []), limit, method, config, regions)
    made_by = shlex.join(["zpm2", *sys.argv[1:]])

    def tell(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr)

    if table is not None:
        if method != "zpm2" or regions is not None or score_only or results is not None or parquet:
            raise ConfigError(
                "--table runs the methods of that table: leave out --method, --regions, --results, --score-only and "
                "--parquet"
            )
        from zpm2.evaluate import table_run

        with fresh_folder(out, names=table_run.file_names(table)):
            print(table_run.run_table(evaluation, table, out, tell))
        return
    if results is not None:
        if method != "zpm2" or regions is not None or score_only:
            raise ConfigError("--results scores another tool's areas: leave out --method, --regions and --score-only")
        with fresh_folder(out, results[1], names=report.names(parquet)):
            rows = evaluation.score_results(*results, out, parquet=parquet, made_by=made_by, tell=tell)
    else:
        with fresh_folder(out, names=file_names(parquet), kept=PREDICTIONS):
            title = f"{dataset}, {method}, preset {preset}"
            rows = evaluation.run(out, score_only=score_only, parquet=parquet, title=title, made_by=made_by, tell=tell)
    warn(f"{values['pair']}: {values['status']}" for values in rows if values["status"] != "ok")
    if not quiet:
        total = {name: value for name, value in report.summary(rows).items() if value is not None}
        print(json.dumps(total, indent=1))
        if results is None and (published := evaluation.published(rows)):
            print(published)
        print(f"Written: {out / 'summary.md'}, {out / 'rows.csv'}")


def _options(texts: list[str]) -> dict[str, Any]:
    """Options of a data set as Python values: "true", "false" and whole numbers become what they mean."""
    found: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name and value):
            raise ConfigError(f"--option {text}: expected NAME=VALUE, for example gap=20")
        found[name] = {"true": True, "false": False}.get(value.lower(), int(value) if value.isdecimal() else value)
    return found
