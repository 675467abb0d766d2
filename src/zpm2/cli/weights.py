"""`zpm2 weights`: see, fetch and check the pre-trained files."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from zpm2 import weights
from zpm2.cli.console import lines
from zpm2.cli.options import WeightsDir, one_of
from zpm2.errors import WeightsError
from zpm2.weights.store import find

app = typer.Typer(help="List, fetch and check the pre-trained weights.", no_args_is_help=True)

NAMES = one_of(lambda: [item.name for item in weights.MANIFEST])


@app.command("list")
def list_(
    weights_dir: WeightsDir = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole manifest as JSON.")] = False,
) -> None:
    """List the weights, their licences and where they are."""
    rows = weights.status(weights_dir)
    if as_json:
        fields = ("name", "file", "size", "sha256", "licence", "commercial_use", "terms", "purpose", "home")
        values = [
            {field: getattr(row.entry, field) for field in fields} | {"path": str(row.path) if row.path else None}
            for row in rows
        ]
        print(json.dumps(values, indent=2))
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table("name", "MB", "here", "licence", "purpose", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.columns[0].no_wrap = table.columns[1].no_wrap = table.columns[2].no_wrap = True
    table.columns[1].justify = "right"
    for item, path in rows:
        here = "-" if path is None else "cache" if path.parent == weights.cache_dir() else "yours"
        table.add_row(item.name, f"{item.size / 1e6:.1f}" if item.hash_known else "?", here, item.licence, item.purpose)
    Console().print(table)
    print(f"cache: {weights.cache_dir()}")


@app.command()
def get(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME...", help="Names as `list` prints them, or all.", autocompletion=NAMES)
    ],
    weights_dir: WeightsDir = None,
    accept_licence: Annotated[
        bool, typer.Option("--accept-licence", help="Accept a licence that forbids commercial use.")
    ] = False,
) -> None:
    """Fetch weights into the cache. `all`: those of known size whose licence you need not accept first."""
    if "all" in names:
        names = [i.name for i in weights.MANIFEST if i.hash_known and (i.commercial_use or accept_licence)]
    for item in map(weights.entry, names):
        if accept_licence and not item.commercial_use:
            print(f"{item.name}: {item.licence}, see {item.terms}", file=sys.stderr)

    def fetch(name: str) -> str:
        with _bar(name) as progress:
            return str(weights.get(name, directory=weights_dir, accept_licence=accept_licence, progress=progress))

    _each(names, fetch)


@app.command()
def verify(
    name: Annotated[
        str | None, typer.Argument(help="Name as `list` prints it.  [default: all that are here]", autocompletion=NAMES)
    ] = None,
    weights_dir: WeightsDir = None,
) -> None:
    """Check the files that are here against their known hashes."""
    if name:
        print(f"{name}: {weights.verify(name, directory=weights_dir)} is intact")
        return

    def check(name: str) -> str:
        path = find(weights.entry(name), weights_dir, rehash=True)
        return f"{path} is intact" if path else "not here"

    _each([item.name for item in weights.MANIFEST], check)


@app.command()
def path(
    name: Annotated[str, typer.Argument(help="Name as `list` prints it.", autocompletion=NAMES)],
    weights_dir: WeightsDir = None,
) -> None:
    """Print the path of a verified file. Nothing is fetched."""
    print(weights.locate(name, directory=weights_dir))


def _each(names: list[str], action: Callable[[str], str]) -> None:
    """Print what `action` returns for each name. Of several names, one that fails does not stop the others."""
    failed: list[str] = []
    for name in names:
        try:
            print(f"{name}: {action(name)}")
        except WeightsError as error:
            if len(names) == 1:
                raise
            failed.append(name)
            print(error, file=sys.stderr)
    if failed:
        raise WeightsError(f"{len(failed)} of {len(names)} weights failed, see above: {', '.join(failed)}")


@contextmanager
def _bar(name: str) -> Iterator[weights.Progress]:
    """A progress bar on the error stream, shown once bytes arrive; a line now and then where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        with lines() as tell:
            yield lambda done, total: tell(name, done / max(total, 1))
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task(name, total=None, visible=False)
        yield lambda done, total: bars.update(task, completed=done, total=total, visible=True)
