"""The command line: assembles the commands, and turns errors into one line and an exit code."""

import errno
import os
import sys
import warnings
from collections.abc import Callable, Mapping
from io import TextIOWrapper
from typing import TYPE_CHECKING, Annotated, TextIO

import typer
from typer.core import TyperGroup

from zpm2.cli import (
    batch,
    bench,
    carry,
    cloud,
    config,
    demo,
    doctor,
    export,
    link,
    match,
    models,
    pose,
    reconstruct,
    serve,
    tracks,
    view,
    weights,
)
from zpm2.cli import eval as evaluation
from zpm2.cli.console import Interrupted, terminable, warn
from zpm2.cli.options import Command
from zpm2.errors import ConfigError, PluginWarning, Zpm2Error
from zpm2.runtime import package_version

if TYPE_CHECKING:
    from typer._click.exceptions import ClickException

    from zpm2.cli.options import Context

COMMANDS: Mapping[str, Callable[..., None] | typer.Typer] = {  # in the order of the help; a Typer has sub-commands
    "demo": demo.demo,
    "match": match.match,
    "carry": carry.carry,
    "tracks": tracks.tracks,
    "batch": batch.batch,
    "link": link.link,
    "pose": pose.pose,
    "reconstruct": reconstruct.reconstruct,
    "cloud": cloud.cloud,
    "export": export.export,
    "view": view.view,
    "app": serve.app,
    "eval": evaluation.evaluate,
    "config": config.app,
    "models": models.models,
    "weights": weights.app,
    "doctor": doctor.doctor,
    "bench": bench.bench,
}

CLASSES = {"eval": evaluation.EvalCommand}  # of commands whose help is made when it is asked for

_show_warning = warnings.showwarning

# Base of typer's usage errors: click's class, or that of the click which newer typers carry inside.
UsageError: "type[ClickException]" = next(
    base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException"
)


class Commands(TyperGroup):
    """The commands in the order in which they were given."""

    order: tuple[str, ...] = ()

    def list_commands(self, ctx: "Context") -> list[str]:
        """Commands with and without sub-commands, which typer keeps apart."""
        return sorted(self.commands, key=self.order.index)

    def invoke(self, ctx: "Context") -> object:
        """As typer does, except that typer would swallow an interrupt with the notes on it."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise Interrupted(stop) from stop


def assemble(commands: Mapping[str, Callable[..., None] | typer.Typer]) -> typer.Typer:
    """The command line of these commands."""
    made = typer.Typer(
        cls=type("Ordered", (Commands,), {"order": tuple(commands)}),
        help="Match polygons between two overlapping photographs.",
        no_args_is_help=True,
        rich_markup_mode=None,
        context_settings={"max_content_width": 1000},  # as wide as the terminal
    )
    made.callback(invoke_without_command=True)(root)
    for name, command in commands.items():
        if isinstance(command, typer.Typer):
            made.add_typer(command, name=name)
        else:
            made.command(name, cls=CLASSES.get(name, Command))(command)
    return made


def root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Match polygons between two overlapping photographs."""
    if version:
        print(package_version())
        raise typer.Exit


app = assemble(COMMANDS)


def main() -> None:
    """Entry point. Misuse prints one line and exits with 2; an interrupt says what stays and exits with 130."""
    if isinstance(sys.stdout, TextIOWrapper):  # names that the code page of a Windows console lacks are no error
        sys.stdout.reconfigure(errors="backslashreplace")
    warnings.showwarning = _one_line
    try:
        _refuse_empty_words(sys.argv[1:])
        with terminable():
            status = app(prog_name="zpm2", standalone_mode=False)
        print(end="", flush=True)
    except Zpm2Error as error:
        sys.exit(_complain(str(error)))
    except OSError as error:
        from zpm2.files.writing import ON_WRITING

        if error.errno in (errno.EPIPE, *ON_WRITING):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Python flushes what is left once more at its end
            sys.exit(1 if error.errno == errno.EPIPE else _complain(f"cannot write: {ON_WRITING[error.errno]}"))
        if error.errno != errno.ENAMETOOLONG:
            raise
        name = str(error.filename)
        sys.exit(_complain(f"a name of {len(name)} letters is too long for a file: {name[:40]}...; give a shorter one"))
    except UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message(), file=sys.stderr)
            sys.exit(2)
        ctx = getattr(error, "ctx", None)
        command = ctx.command_path if ctx else "zpm2"
        sys.exit(_complain(f"{error.format_message().rstrip('.')}; see {command} --help"))
    except (Interrupted, typer.Abort, KeyboardInterrupt) as stop:
        _complain(str(stop) or "interrupted")
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def _refuse_empty_words(words: list[str]) -> None:
    """An empty word (of a shell variable that is not set, for instance) would mean the current folder."""
    for before, word in zip(["the first argument", *words], words, strict=False):
        if not word or (word.startswith("--") and word.endswith("=")):
            raise ConfigError(f"{word.rstrip('=') or f'the value after {before}'} is empty: give one")


def _one_line(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning about a plug-in in one line; others as Python shows them."""
    if issubclass(category, PluginWarning):
        warn([str(message)])
    else:
        _show_warning(message, category, filename, lineno, file, line)


def _complain(text: str) -> int:
    print(f"zpm2: {' '.join(text.split())}", file=sys.stderr)
    return 2
