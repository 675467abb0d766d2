"""Builds the documentation site from docs/, and checks it.

    python docs/site/build.py [FOLDER]

FOLDER (build/site, if none is given) gets pages/, what the site is made from, and html/, the site. Look at it, with its
search, by python -m http.server -d build/site/html.
Stops at a broken link, at a page that is not in the navigation, and at anything that a page would load from elsewhere.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import typer.cli
from typer.main import get_command

HERE = Path(__file__).resolve().parent
DOCS, ROOT = HERE.parent, HERE.parent.parent
ABOVE = ("README", "SECURITY", "CONTRIBUTING", "CHANGELOG")  # pages of the site that lie above docs/
LINK = re.compile(r"\]\(([^)\s]+)\)")
LOADED = re.compile(r"""<(?:link|script|img|iframe|source|video)\b[^>]*?\s(?:href|src)=["']?(?:https?:)?//[^"'\s>]+""")


def gather(pages: Path) -> None:
    """Copies every page, and writes the reference of the commands."""
    shutil.copytree(DOCS, pages, ignore=shutil.ignore_patterns("site", ".ipynb_checkpoints"))
    for name in ABOVE:
        text = LINK.sub(lambda link: f"]({below(link[1])})", (ROOT / f"{name}.md").read_text(encoding="utf-8"))
        (pages / f"{name.lower()}.md").write_text(text, encoding="utf-8")
    for page in DOCS.glob("*.md"):
        text = LINK.sub(lambda link: f"]({below(link[1])})", page.read_text(encoding="utf-8"))
        (pages / page.name).write_text(text, encoding="utf-8")
    (pages / "commands.md").write_text(commands(), encoding="utf-8")
    for name in ("style.css", "python.md"):
        shutil.copy(HERE / name, pages)


def below(target: str) -> str:
    """A link as it is where all pages lie in one folder."""
    path, mark, place = target.partition("#")
    path = path.removeprefix("../").removeprefix("docs/")
    if path.removesuffix(".md") in ABOVE:
        path = path.lower()
    return path + mark + place


def commands() -> str:
    """The reference of the command line, as typer makes it."""
    from zpm2.cli.app import app

    command = get_command(app)
    for name in command.list_commands(typer.Context(command)):
        one = command.commands[name]
        one.short_help = (one.help or "").partition("\n")[0]  # else typer cuts it
    context = typer.Context(command, info_name="zpm2", color=False)
    return typer.cli.get_docs_for_click(obj=command, ctx=context, name="zpm2", title="Commands")


def not_in_navigation(pages: Path) -> set[str]:
    """Pages that nobody would find."""

    def listed(entries: list[object] | str) -> Iterator[str]:
        for entry in [entries] if isinstance(entries, str) else entries:
            if isinstance(entry, dict):
                for value in entry.values():
                    yield from listed(value)
            else:
                yield str(entry)

    navigation = tomllib.loads((HERE / "zensical.toml").read_text(encoding="utf-8"))["project"]["nav"]
    return {page.name for page in pages.glob("*.md")} - set(listed(navigation))


def from_elsewhere(html: Path) -> list[str]:
    """What the pages would load from another server."""
    return [
        f"{page.relative_to(html)}: {found}"
        for page in sorted(html.rglob("*.html"))
        for found in LOADED.findall(page.read_text(encoding="utf-8"))
    ]


def build(folder: Path) -> None:
    """All of it. `SystemExit` with what is wrong."""
    for made in ("pages", "html", ".cache"):
        shutil.rmtree(folder / made, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    gather(folder / "pages")
    if missing := not_in_navigation(folder / "pages"):
        sys.exit(f"not in the navigation of docs/site/zensical.toml: {', '.join(sorted(missing))}")
    shutil.copy(HERE / "zensical.toml", folder)
    paths = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(folder / "zensical.toml")]
    done = subprocess.run(words, env=os.environ | {"PYTHONPATH": paths}, check=False)
    if done.returncode:
        sys.exit(done.returncode)
    if loaded := from_elsewhere(folder / "html"):
        sys.exit("the site would load from elsewhere:\n" + "\n".join(loaded))


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "site").resolve())
