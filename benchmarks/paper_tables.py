"""What the scripts of the paper's tables share: run `zpm2 eval`, print published rows beside measured ones."""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from zpm2.evaluate.report import table

PUBLISHED, MEASURED = "published, not measured here", "measured"


def parser(about: str | None) -> argparse.ArgumentParser:
    """Options that every table has. A data set is given as NAME=KIND:FOLDER, as in SceneFlow=sceneflow:/data/ft3d."""
    options = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", action="append", required=True, metavar="NAME=KIND:FOLDER")
    options.add_argument("--limit", type=int, help="the first so many pairs of each data set")
    options.add_argument("-o", "--out", type=Path, required=True, help="predictions and scores; a run can be resumed")
    return options


def data_sets(options: argparse.Namespace) -> Iterable[tuple[str, str, str]]:
    """(name as in the paper, kind as `zpm2 eval` calls it, folder) of each --data."""
    for text in options.data:
        name, _, rest = text.partition("=")
        kind, _, folder = rest.partition(":")
        if not (name and kind and folder):
            sys.exit(f"--data {text}: expected NAME=KIND:FOLDER, for example SceneFlow=sceneflow:/data/ft3d")
        yield name, kind, folder


def measure(
    options: argparse.Namespace,
    name: str,
    kind: str,
    folder: str,
    label: str,
    words: Sequence[str] = (),
    regions: str | None = None,
) -> dict[str, Any]:
    """The summary of `zpm2 eval` with some more options, kept in a folder of its own; on the polygons of the run with
    the label `regions`, if one is named."""
    out = options.out / f"{name}-{label}"
    command = ["zpm2", "eval", kind, "--root", folder, "-o", str(out), "--preset", "paper", *words]
    if regions and regions != label:
        command += ["--regions", str(options.out / f"{name}-{regions}")]
    if options.limit:
        command += ["--limit", str(options.limit)]
    run = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    if run.returncode:
        sys.exit(run.returncode)
    return dict(json.loads((out / "summary.json").read_text()))


def percent(summary: dict[str, Any], name: str) -> float | None:
    """A share of the summary in per cent."""
    return None if summary.get(name) is None else 100 * summary[name]


def show(columns: Sequence[str], published: Iterable[Sequence[Any]], measured: Iterable[Sequence[Any]]) -> None:
    """Print the rows, published ones first, each marked as what it is."""
    rows = [[*row, PUBLISHED] for row in published] + [[*row, MEASURED] for row in measured]
    print(table([*columns, "source"], rows))
