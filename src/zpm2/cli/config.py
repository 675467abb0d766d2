"""`zpm2 config`: what can be set, and what a run would use."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Annotated

import typer

from zpm2.cli.options import Command, ConfigFile, Preset, Settings, configure

app = typer.Typer(help="Show the fields that --set and --config can change.", no_args_is_help=True)


@app.command("list", cls=Command)
def list_(
    preset: Preset = "default",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List every field: type, value, unit and meaning."""
    from zpm2 import config

    rows = list(config.describe(config.preset(preset)))
    if as_json:
        names = "option", "type", "value", "meaning"
        print(json.dumps([dict(zip(names, row, strict=True)) for row in rows], indent=1))
        return
    texts = [(name, kind, _word(value), meaning) for name, kind, value, meaning in rows]
    width = [max(len(row[k]) for row in texts) for k in range(3)]
    for row in texts:
        print("  ".join([*(text.ljust(n) for text, n in zip(row, width, strict=False)), row[3]]).rstrip())


@app.command(cls=Command)
def show(
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead; --config reads it, too.")] = False,
) -> None:
    """Print the whole configuration as TOML.

    Save it, change it, and give it to --config.
    """
    values = configure(preset, config_file, settings).to_dict()
    if as_json:
        print(json.dumps(values, indent=1))
        return
    print("\n".join(_toml(values)))


def _toml(table: Mapping[str, object], name: str = "") -> Iterator[str]:
    """The lines of a table of TOML: its values, then the tables in it."""
    named = [(key if re.fullmatch("[A-Za-z0-9_-]+", key) else _quoted(key), value) for key, value in table.items()]
    yield from (f"{key} = {_quoted(value)}" for key, value in named if not isinstance(value, dict))
    for key, value in named:
        if isinstance(value, dict):
            yield f"\n[{name}{key}]"
            yield from _toml(value, f"{name}{key}.")


def _quoted(value: object) -> str:
    """A value of TOML, in ASCII. JSON writes what is beyond 16 bits as two characters, which TOML refuses."""
    return re.sub("[^ -~]", lambda found: f"\\U{ord(found[0]):08x}", json.dumps(value, ensure_ascii=False))


def _word(value: object) -> str:
    """A value as --set takes it."""
    if isinstance(value, dict):
        return ",".join(f"{name}={_word(each)}" for name, each in value.items()) or "-"
    if isinstance(value, tuple):
        return ",".join(map(str, value)) or "-"
    return str(value).lower() if isinstance(value, bool) else str(value)
