"""`zpm2 eval`: a data set through the method, scored against its ground truth."""

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperArgument

from zpm2.cli.console import fresh_folder, warn
from zpm2.cli.options import (
    DATA,
    METHOD,
    RESULT,
    AllowVrt,
    Command,
    HelpFormatter,
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

if TYPE_CHECKING:
    from zpm2.cli.options import Context


class EvalCommand(Command):
    """`zpm2 eval`, whose help names the registered data sets."""

    def format_options(self, ctx: "Context", formatter: HelpFormatter) -> None:
        """As `Command`; the data sets are looked up now, as their modules take time to load."""
        for item in self.get_params(ctx):
            if isinstance(item, TyperArgument) and item.name == "dataset":
                item.help = f"One of {', '.join(datasets())}; see docs/datasets.md."
        super().format_options(ctx, formatter)


def evaluate(
    dataset: Annotated[str, typer.Argument(help="Name of the data set.", autocompletion=one_of(datasets))],
    root: Annotated[Path, typer.Option(help="Folder of the data set, laid out as published.", rich_help_panel=DATA)],
    out: Out = Path("zpm2-eval"),
    split: Annotated[str | None, typer.Option(help="One part of the data set.", rich_help_panel=DATA)] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="An option of the data set (docs/datasets.md). Repeatable.",
            rich_help_panel=DATA,
        ),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Only the first N pairs.", rich_help_panel=DATA)
    ] = None,
    preset: Preset = "default",
    settings: Settings = None,
    method: Method = "zpm2",
    regions: Annotated[
        Path | None,
        typer.Option(
            help="Folder of an earlier evaluation: use its polygons instead of detecting regions.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    results: Annotated[
        tuple[str, Path] | None,
        typer.Option(
            "--results",
            metavar="FORMAT FOLDER",
            help="Score another tool's area matches instead (docs/peers.md): areas, masa or sam2, and their folder.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    table: Annotated[
        int | None,
        typer.Option(
            "--table",
            min=1,
            max=6,
            help="A table of the paper: every row that can be run, beside the published ones.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    score_only: Annotated[
        bool,
        typer.Option("--score-only", help="Match nothing; score the predictions again.", rich_help_panel=RESULT),
    ] = False,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Also write rows.parquet.", rich_help_panel=RESULT)
    ] = False,
    allowed: AllowVrt = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
) -> None:
    """Score the matches of every pair of a data set.

    They are matched first, or another tool wrote them (--results).

    Writes rows.csv, summary.json, summary.md and the prediction of each pair. If a run was interrupted, start the same
    command again: it continues where it stopped. --score-only scores the predictions again and needs no weights.
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
        print(json.dumps(report.known(report.summary(rows)), indent=1))
        if results is None and (published := evaluation.published(rows)):
            print(published)
        print(f"Written: {out / 'summary.md'}, {out / 'rows.csv'}")


def _options(texts: list[str]) -> dict[str, bool | int | str]:
    """Options of a data set as Python values: "true", "false" and whole numbers become what they mean."""
    found: dict[str, bool | int | str] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name and value):
            raise ConfigError(f"--option {text}: expected NAME=VALUE, for example gap=20")
        found[name] = {"true": True, "false": False}.get(value.lower(), int(value) if value.isdecimal() else value)
    return found
