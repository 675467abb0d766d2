"""`zpm2 view`: a result in the browser."""

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from zpm2.errors import InputError

CLOUD = "cloud.html"
TRACKS = "tracks.json"
# of results, in whose folders the pages are
FILES = "matches.json", "carry.json", "pose.json", TRACKS, "cloud.json", "report.html", CLOUD, "index.html"


def view(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a result, an evaluation or many results.")],
    no_open: Annotated[bool, typer.Option("--no-open", help="Only print the path of the page.")] = False,
    reports: Annotated[
        int, typer.Option(min=0, help="Of many results: how many of the worst pairs get a page of their own.")
    ] = 20,
) -> None:
    """Open a result in the browser.

    Shows report.html of zpm2 match, carry, pose, tracks and demo, and cloud.html of zpm2 cloud. Makes that of zpm2
    match where it is missing. For an evaluation, and for a folder with results in folders below it, writes index.html:
    a table of the pairs with thumbnails and links to their reports, the worst first.
    """
    if out.is_file() and out.name not in FILES:
        raise InputError(f"{out} is not a file of a result: give its folder")
    page = _page(out.parent if out.is_file() else out, reports).resolve()
    print(page)
    if not (no_open or webbrowser.open(page.as_uri())):
        raise InputError(f"no browser was found: open {page} yourself")


def _page(folder: Path, reports: int) -> Path:
    """The page of a folder, made where it is missing."""
    from zpm2.formats.saving import DOCUMENT, REPORT

    for name in (REPORT, CLOUD):
        if (folder / name).is_file():
            return folder / name
    if (folder / DOCUMENT).is_file():
        from zpm2.result import save_report

        return save_report(folder)
    if (folder / TRACKS).is_file():
        raise InputError(f"{folder} has no {REPORT}: run zpm2 tracks again, which uses its finished pairs")
    from zpm2.evaluate.overview import found_below, save_overview

    found = found_below(folder)
    if len(found) == 1 and (found[0] / REPORT).is_file():
        return found[0] / REPORT
    if not found:
        raise InputError(
            f"{folder} holds no result: give a folder that zpm2 match, carry, pose, tracks, demo, cloud or eval wrote, "
            "or one with such folders in it"
        )
    return save_overview(folder, reports, lambda name: print(f"report of {name}", file=sys.stderr))
