"""How the command line is assembled, and what a further command takes."""

import ast
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from rendered import Run

import zpm2.cli
from zpm2.cli import app
from zpm2.errors import InputError

TOY = '''
"""`zpm2 toy`: a command in one file."""

from pathlib import Path
from typing import Annotated

import typer

from zpm2.cli.options import Out
from zpm2.errors import InputError


def toy(name: Annotated[str, typer.Argument(help="Whom to greet.")], out: Out = Path("zpm2-toy")) -> None:
    """Greet somebody."""
    if name == "nobody":
        raise InputError("nobody cannot be greeted: give a name")
    print(f"hello {name}, {out}")
'''


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    (tmp_path / "toy_command.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    import toy_command  # type: ignore[import-not-found]

    monkeypatch.delitem(sys.modules, "toy_command")
    found: Callable[..., None] = toy_command.toy
    return found


def test_a_command_is_a_file_and_a_line(toy: Callable[..., None], run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app, "app", app.assemble({**app.COMMANDS, "toy": toy}))
    assert run("toy", "world", "-o", "there") == (0, "hello world, there\n", "")
    assert run("toy", "nobody") == (2, "", "zpm2: nobody cannot be greeted: give a name\n")
    assert "Whom to greet." in run("toy", "--help").out
    assert [line.split()[0] for line in run("--help").out.partition("Commands:\n")[2].splitlines()][-1] == "toy"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/dev/full is a file of Linux")
def test_output_that_cannot_be_printed_is_one_line() -> None:
    for words in (["--version"], ["config", "list"]):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-m", "zpm2", *words], stdout=full, stderr=subprocess.PIPE, text=True
            )
        assert (done.returncode, done.stderr) == (2, "zpm2: cannot write: the disk is full; free some space\n")


def test_each_command_has_a_file_of_its_name() -> None:
    folder = Path(zpm2.cli.__file__).parent
    files = {path.stem for path in folder.glob("*.py")}
    files = {"app" if stem == "serve" else stem for stem in files - {"app"}}  # app.py puts the commands together
    assert files == {*app.COMMANDS, "options", "engines", "console", "__init__"}


def test_commands_load_the_package_when_they_run() -> None:
    """At the top of their files they import no more than options, errors and the table of weights."""
    light = ("zpm2.cli", "zpm2.errors", "zpm2.runtime", "zpm2.weights", "zpm2.weights.store")
    for path in Path(zpm2.cli.__file__).parent.glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("zpm2."):
                assert str(node.module).startswith(light), f"{path.name} imports {node.module}"


def test_sub_commands_are_a_typer(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    group = typer.Typer(help="Several.")

    def stop() -> None:
        """Stop."""
        raise InputError("stopped")

    def go() -> None:
        """Go."""
        print("gone")

    for function in (stop, go):
        group.command()(function)
    commands: dict[str, Any] = {"several": group}
    monkeypatch.setattr(app, "app", app.assemble(commands))
    assert run("several", "go").out == "gone\n"
    assert run("several", "stop") == (2, "", "zpm2: stopped\n")
