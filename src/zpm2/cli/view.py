"""`zpm2 view`: a result in the browser."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from zpm2.errors import InputError

CLOUD = "cloud.html"


def view(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a result.")],
    no_open: Annotated[bool, typer.Option("--no-open", help="Only print the path of the page.")] = False,
) -> None:
    """Open a result in the browser.

    Shows report.html of zpm2 match, pose and demo, and cloud.html of zpm2 cloud. Makes report.html where it is missing.
    """
    page = _page(out.parent if out.is_file() else out).resolve()
    print(page)
    if not (no_open or webbrowser.open(page.as_uri())):
        raise InputError(f"no browser was found: open {page} yourself")


def _page(folder: Path) -> Path:
    """The page of a folder, made where it is missing."""
    from zpm2.formats.saving import DOCUMENT, REPORT

    for name in (REPORT, CLOUD):
        if (folder / name).is_file():
            return folder / name
    if (folder / DOCUMENT).is_file():
        from zpm2.result import save_report

        return save_report(folder)
    raise InputError(f"{folder} holds no result: give a folder that zpm2 match, pose, demo or cloud wrote")
