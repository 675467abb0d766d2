"""`zpm2 models`: the segmenters and point matchers there are, what each needs, and how fast it is here."""

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated

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
    """List the segmenters and point matchers, and what they need.

    Task, licences, training data, size, device, and whether they are here, of built-in ones and of those of other
    packages. Nothing is downloaded. With --measure each runs in a new process.
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


def _others() -> list[dict[str, str]]:
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


def _plain(row: "ModelRow") -> dict[str, object]:
    from dataclasses import asdict

    values = asdict(row)
    return (
        {name: values.pop(name) for name in ("kind", "name", "origin")}
        | values.pop("info")
        | values
        | {"here": row.here}
    )


def _print(rows: "list[ModelRow]", others: list[dict[str, str]], measured: bool) -> None:
    for kind in dict.fromkeys(row.kind for row in rows):
        print(f"{kind}s")
        for row in (row for row in rows if row.kind == kind):
            print(f"  {row.name:<18} {'here' if row.here else 'not here'}, {', '.join(_facts(row))}")
            print(f"    {row.info.task}; trained on {row.info.training_data}")
            print(f"    licence of the code: {row.info.code_licence}; of the weights: {row.weights_licence}")
            for command in row.missing:
                print(f"    needs: {command}")
            if measured:
                print(f"    {_figures(row)}")
        print()
    for kind in dict.fromkeys(other["kind"] for other in others):
        print(f"{kind}s")
        for other in (other for other in others if other["kind"] == kind):
            print(f"  {other['name']:<18} {other['task']}; {other['origin']}")
        print()


def _facts(row: "ModelRow") -> list[str]:
    size = f"{row.size / 1e6:.1f} MB" if row.size else "size unknown" if row.info.weights else "no weights"
    sees = "any size of image" if row.info.input_size == "any" else f"images of {row.info.input_size}"
    return [size, sees, row.info.device.replace(", ", " or "), row.origin]


def _figures(row: "ModelRow") -> str:
    found = row.measured
    if found is None or isinstance(found, str):
        return "not measured"
    peak = "unknown" if found.peak_mb is None else f"{found.peak_mb} MB"
    what = "image" if row.kind == "segmenter" else "pair"
    return f"measured: {found.load:.1f} s to load, {found.seconds:.2f} s for one {what}, peak memory {peak}"
