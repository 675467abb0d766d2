"""`zpm2 models`: the segmenters and point matchers there are, what each needs, and how fast it is here."""

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zpm2.cli.console import warn
from zpm2.cli.options import (
    WeightsDir,
    one_of,
    point_matchers,
    registered_segmenters,
    use_weights,
)

if TYPE_CHECKING:
    from zpm2.evaluate.models import ModelRow


def _names() -> Iterable[str]:
    return [*registered_segmenters(), *point_matchers()]


def models(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME...]", help="Only these, by name or package.module:Class.", autocompletion=one_of(_names)
        ),
    ] = None,
    measure: Annotated[
        bool,
        typer.Option(
            "--measure", help="Run each that is here on one rendered image or pair; print its seconds and memory."
        ),
    ] = False,
    all_kinds: Annotated[bool, typer.Option("--all", help="List data sets and formats, too.")] = False,
    weights_dir: WeightsDir = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """List the segmenters and point matchers: task, licences, training data, size, device, whether they are here.

    Built-in ones, and those of other packages. Nothing is downloaded. With --measure each runs in a new process.
    """
    from zpm2.evaluate import models as listing

    use_weights(weights_dir)
    found = listing.rows(names or [])
    if measure:
        found = [_measured(row) for row in found]
        warn(f"{row.name} was not measured: {row.measured}" for row in found if isinstance(row.measured, str))
    others = _others() if all_kinds else []
    if as_json:
        print(json.dumps([*map(_plain, found), *others], indent=1))
    else:
        _print(found, others, measure)


def _measured(row: "ModelRow") -> "ModelRow":
    from zpm2.evaluate import models as listing

    if not row.here:
        return row
    print(f"measuring {row.name}", file=sys.stderr)
    return listing.measure(row)


def _others() -> list[dict[str, Any]]:
    """The data sets and the formats that can be used, with their origins."""
    from zpm2.evaluate.datasets import DATASETS
    from zpm2.formats.registry import FORMATS

    found = [
        {"kind": "data set", "name": name, "origin": DATASETS.origin(name), "task": f"truth: {part.truth}"}
        for name, part in DATASETS.items()
    ]
    return found + [
        {"kind": "format", "name": name, "origin": FORMATS.origin(name), "task": f"writes {_few(part.files)}"}
        for name, part in FORMATS.items()
    ]


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (" ..." if len(names) > 3 else "")


def _plain(row: "ModelRow") -> dict[str, Any]:
    from dataclasses import asdict

    values = asdict(row)
    return (
        {name: values.pop(name) for name in ("kind", "name", "origin")}
        | values.pop("info")
        | values
        | {"here": row.here}
    )


def _print(rows: "list[ModelRow]", others: list[dict[str, Any]], measured: bool) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console()
    names = ["name", "task", "licence of code, of weights", "trained on", "MB", "device", "here", "origin"]
    for kind in dict.fromkeys(row.kind for row in rows):
        table = Table(
            *names,
            *(["load s", "s", "peak MB"] if measured else []),
            title=f"{kind}s",
            title_justify="left",
            box=box.SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        table.columns[0].no_wrap = True
        for column in (4, *range(len(names), len(table.columns))):
            table.columns[column].justify, table.columns[column].no_wrap = "right", True
        for row in (row for row in rows if row.kind == kind):
            table.add_row(*_cells(row), *(_figures(row) if measured else []))
        console.print(table)
    for row in rows:
        for command in row.missing:
            console.print(f"{row.name} needs: {command}", soft_wrap=True, highlight=False, markup=False)
    if others:
        table = Table("kind", "name", "task", "origin", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for other in others:
            table.add_row(other["kind"], other["name"], other["task"], other["origin"])
        console.print(table)


def _cells(row: "ModelRow") -> list[str]:
    info = row.info
    size = "?" if row.size is None else f"{row.size / 1e6:.1f}" if row.size else "-"
    licences = f"{info.code_licence}, {row.weights_licence}"
    return [
        row.name,
        info.task,
        licences,
        info.training_data,
        size,
        info.device,
        "yes" if row.here else "no",
        row.origin,
    ]


def _figures(row: "ModelRow") -> list[str]:
    found = row.measured
    if found is None or isinstance(found, str):
        return ["-"] * 3
    return [f"{found.load:.1f}", f"{found.seconds:.2f}", "?" if found.peak_mb is None else str(found.peak_mb)]
